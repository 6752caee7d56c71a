"""What ``check`` says of a configuration and of the recordings that it names."""
