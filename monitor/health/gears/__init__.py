"""Gears beside a bearing: which wheels there are, what a turn of each looks like, and which one is damaged."""
