"""Speed against error: each a script that prints a table and, with ``--json FILE``, writes the same figures."""
