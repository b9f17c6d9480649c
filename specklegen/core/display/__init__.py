"""Display of results, signatures and names from elsewhere: in a line, in a picture, in a file."""
