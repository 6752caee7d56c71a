"""What is known of ``[gear]`` here: its keys come with the extra that describes trains of gears."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

from monitor.config.fields import Section
from monitor.health.gears.settings import GearSettings


class TrainSection(Section):
    """The gears beside the monitored bearings."""

    @property
    @abstractmethod
    def speed_shaft(self) -> str:
        """The shaft on which the speed of ``[operating]`` counts."""

    @abstractmethod
    def to_settings(self) -> GearSettings:
        """Return wheels and pairs, with turns of wheels per turn of ``speed_shaft``."""

    @classmethod
    @abstractmethod
    def model_keys(cls) -> dict[str, Any]:
        """Return the keys on which no record depends: those that the model alone takes."""
