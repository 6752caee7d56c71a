"""The six-degree-of-freedom model of a bearing on its rig (thesis of A. Gabrielli, Ferrara 2022)."""
