"""Static figures that the thesis prints, each beside what this program obtains."""
