"""``spallwatch simulate``: one scene, and what comes of it."""
