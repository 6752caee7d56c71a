"""Health records: their schema, the SQLite store that holds the truth, the netCDF files made from it."""
