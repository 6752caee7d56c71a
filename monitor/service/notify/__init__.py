"""Notifications of events: e-mail, webhook, MQTT."""
