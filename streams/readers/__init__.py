"""One reader a file format; each gives arrays and what the file says of them, and guesses nothing."""
