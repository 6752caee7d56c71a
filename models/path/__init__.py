"""Paths of rolling elements over defects: localised, extended, rough, of any part."""
