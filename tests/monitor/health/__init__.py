"""Tests of ``monitor/health``."""
