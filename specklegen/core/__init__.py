"""Tools of every room, without physics: values, errors, random streams, threads, statistics, memory."""
