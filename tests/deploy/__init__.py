"""Tests of the service under systemd."""
