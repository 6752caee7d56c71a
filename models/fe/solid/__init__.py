"""Elastic bodies of finite elements: assembly, factorisation, loads, and contact in pressure cells."""
