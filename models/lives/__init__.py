"""Simulated lives: growth laws, populations, and what a monitor measures of each life."""
