"""Tests of ``monitor/desk``."""
