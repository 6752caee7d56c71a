"""One function a format: from bytes to samples and what the file states."""
