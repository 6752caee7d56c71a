"""The import desk: how a folder of recordings is read, by evidence and answers; for ``init``, the page and Python."""
