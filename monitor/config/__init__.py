"""The configuration: sections with units in their keys, validated and turned into SI settings."""
