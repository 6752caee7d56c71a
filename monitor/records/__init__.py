"""Health records: the SQLite store that holds the truth, and the netCDF files made from it."""
