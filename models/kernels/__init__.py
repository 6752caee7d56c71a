"""numba kernels: plain float64 arrays in, arrays of the caller out, an int status back. Import them where they run."""
