"""What results, signatures and names from elsewhere look like: in a line, in a picture, in a file."""
