"""Report of an identification: what the tests determine, what they do not, and how the model meets them."""
