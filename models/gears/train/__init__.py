"""Motion of trains of gears: bodies, supports and meshes, and how they are solved."""
