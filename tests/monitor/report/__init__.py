"""Tests of ``monitor/report``."""
