"""Telling people and programs of events: e-mail, webhook, MQTT."""
