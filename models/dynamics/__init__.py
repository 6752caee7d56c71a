"""One file a dynamic model; each turns a Scene into a Response."""
