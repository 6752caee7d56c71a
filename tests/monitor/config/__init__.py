"""Tests of ``monitor/config``."""
