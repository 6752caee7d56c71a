"""One function a format: bytes in, arrays and what the file itself says out, nothing guessed."""
