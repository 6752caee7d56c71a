"""numba kernels: plain float64 arrays in, arrays of the caller out, an int status back. Import them where they run."""

from models.kernels.linkage import keep_copies

keep_copies()
