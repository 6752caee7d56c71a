"""The stages of health assessment: pure functions of explicit state; no clock, no files, no network."""
