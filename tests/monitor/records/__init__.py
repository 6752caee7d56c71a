"""Tests of ``monitor/records``."""
