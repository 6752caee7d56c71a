"""Printed figures beside what this program computes."""
