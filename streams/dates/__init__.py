"""What dates a file."""
