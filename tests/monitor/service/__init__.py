"""Tests of ``monitor/service``."""
