"""What flows and what is asked: samples, blocks, sources and their configuration."""
