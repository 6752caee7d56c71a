"""A simulated rig with a bearing that wears out."""
