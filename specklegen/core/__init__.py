"""What every room uses and no physics: values, errors, random streams, threads, statistics, memory."""
