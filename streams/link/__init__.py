"""Blocks over a network: TCP, MQTT, the frames of both, and the reference sender."""
