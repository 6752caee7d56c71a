"""What a block of acceleration says about the health of a bearing (third floor)."""

__version__ = "0.1.0"
