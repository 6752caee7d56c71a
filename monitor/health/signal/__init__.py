"""From samples to spectra and features: transforms, fault lines, bands, speed."""
