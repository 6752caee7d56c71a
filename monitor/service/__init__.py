"""What runs the pipeline: the daemon, replay of recordings, and the outputs beside them."""
