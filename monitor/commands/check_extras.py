"""What ``check`` says of packages that sections need and that are not installed."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator

from monitor.config.load import Config


def missing_extras(config: Config) -> Iterator[str]:
    """Yield what to install for sections whose packages are missing; the daemon runs without them."""
    sections = (
        ("publish.mqtt", config.publish.mqtt, "mqtt", ("paho",)),
        ("publish.sparkplug", config.publish.sparkplug, "sparkplug", ("paho", "google.protobuf")),
        ("publish.opcua", config.publish.opcua, "opcua", ("asyncua",)),
        ("operating.opcua", config.operating.opcua, "opcua", ("asyncua",)),
        ("notify.mqtt", config.notify.mqtt, "mqtt", ("paho",)),
    )
    for name, section, extra, modules in sections:
        if section is not None and not all(map(_is_installed, modules)):
            yield f'[{name}] needs more packages: pip install "spallwatch[{extra}]"'


def _is_installed(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:
        return False
