"""Shafts of finite elements: k_i of a stepped shaft, and a shaft inside an inner ring."""
