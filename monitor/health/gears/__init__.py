"""Damaged gears beside a bearing: which wheels there are, what each turn of a wheel looks like, and which is damaged."""
