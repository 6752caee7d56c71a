"""What runs the pipeline: replay of recordings now, the daemon later."""
