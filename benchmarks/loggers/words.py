"""What loggers write above their numbers, in three languages and many spellings."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from benchmarks.loggers.plan import SPEED_HZ, Draw

WORDS = {
    "en": {
        "rate": ("Sample Rate", "Sampling Frequency", "Sampling rate", "fs"),
        "interval": ("Sample Interval", "dt", "Sampling period"),
        "start": ("Start Time", "Start", "Recording started"),
        "date": ("Date",),
        "time": ("Time",),
        "unit": ("Unit", "Units", "Y Unit"),
        "sensitivity": ("Sensitivity", "Sensor sensitivity"),
        "count": ("Samples", "Number of samples"),
        "device": ("Instrument", "Device", "Logger"),
        "speed": ("Speed", "Shaft speed"),
        "zone": ("Time zone", "Timezone"),
        "scale": ("Scale", "Resolution"),
        "acceleration": ("Acc {}", "Accel {}", "Vibration {}", "a{}"),
        "velocity": ("Velocity {}",),
        "temperature": ("Temperature", "Temp"),
        "rpm": ("Speed", "RPM"),
        "tacho": ("Tacho", "Keyphasor"),
        "index": ("Sample", "Index", "No."),
        "seconds": ("Time", "t", "Elapsed time"),
    },
    "de": {
        "rate": ("Abtastrate", "Abtastfrequenz"),
        "interval": ("Abtastintervall", "Abtastperiode"),
        "start": ("Startzeit", "Beginn", "Start"),
        "date": ("Datum",),
        "time": ("Uhrzeit", "Zeit"),
        "unit": ("Einheit",),
        "sensitivity": ("Empfindlichkeit",),
        "count": ("Anzahl Werte", "Anzahl Messwerte"),
        "device": ("Messsystem", "Gerät"),
        "speed": ("Drehzahl",),
        "zone": ("Zeitzone",),
        "scale": ("Skalierung", "Auflösung"),
        "acceleration": ("Beschleunigung {}", "Schwingung {}", "Kanal {}"),
        "velocity": ("Schwinggeschwindigkeit {}",),
        "temperature": ("Temperatur",),
        "rpm": ("Drehzahl",),
        "tacho": ("Tacho", "Impuls"),
        "index": ("Nr.", "Index"),
        "seconds": ("Zeit", "t"),
    },
    "fr": {
        "rate": ("Fréquence d'échantillonnage", "Fréquence échantillonnage"),
        "interval": ("Période d'échantillonnage",),
        "start": ("Début", "Départ"),
        "date": ("Date",),
        "time": ("Heure",),
        "unit": ("Unité",),
        "sensitivity": ("Sensibilité",),
        "count": ("Nombre d'échantillons",),
        "device": ("Appareil",),
        "speed": ("Vitesse de rotation",),
        "zone": ("Fuseau horaire",),
        "scale": ("Échelle",),
        "acceleration": ("Accélération {}", "Voie {}"),
        "velocity": ("Vitesse vibratoire {}",),
        "temperature": ("Température",),
        "rpm": ("Vitesse de rotation",),
        "tacho": ("Tachymètre",),
        "index": ("N°", "Index"),
        "seconds": ("Temps", "t"),
    },
}
"""By language: spellings of a key or of the name of a column."""

_DATES = {
    "en": ("%Y-%m-%dT%H:%M:%S", "%Y/%m/%d %H:%M:%S", "%d-%b-%Y %H:%M:%S", "%m/%d/%Y %I:%M:%S %p"),
    "de": ("%d.%m.%Y %H:%M:%S", "%Y-%m-%d %H:%M:%S"),
    "fr": ("%d/%m/%Y %H:%M:%S", "%Y-%m-%dT%H:%M:%S"),
}


@dataclass(frozen=True)
class Spelling:
    """How a logger writes: language, decimal sign, how a key and its value are joined, what stands before a line."""

    language: str
    decimal: str
    join: str
    mark: str

    def number(self, value: float, digits: int = 12) -> str:
        """Return a number with the decimal sign of the logger."""
        return f"{value:.{digits}g}".replace(".", self.decimal)

    def word(self, draw: Draw, what: str) -> str:
        """Return one of the spellings of a key."""
        return draw.one(f"word_{what}", WORDS[self.language][what])


def rate_line(draw: Draw, spelling: Spelling, rate: float) -> tuple[str, str, bool]:
    """Return key and value that state a rate, and whether the value can be read in two ways."""
    style = draw.one(
        "rate_style", ["Hz", "kHz", "key", "key_kHz", "thousands", "interval", "bare"], [5, 3, 2, 1, 2, 2, 1]
    )
    if style == "interval":
        unit, factor = draw.one("interval_unit", [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("µs", 1e6)])
        return spelling.word(draw, "interval"), f"{spelling.number(factor / rate)} {unit}", False
    key = spelling.word(draw, "rate")
    if style == "thousands":
        sign = draw.one("thousands", {"en": [","], "de": [".", " "], "fr": [" ", " "]}[spelling.language])
        text = f"{rate:,.0f}".replace(",", sign)
        return key, f"{text} Hz", sign in ".,"
    if style.endswith("kHz"):
        value, unit = spelling.number(rate / 1e3), "kHz"
    else:
        value, unit = spelling.number(rate), "Hz"
    if style.startswith("key"):
        brackets = draw.one("key_brackets", ["()", "[]"])
        return f"{key} {brackets[0]}{unit}{brackets[1]}", value, False
    return key, value if style == "bare" else f"{value} {unit}", False


def start_lines(draw: Draw, spelling: Spelling, wall: datetime) -> tuple[list[tuple[str, str]], bool, bool]:
    """Return keys and values that state a start; whether the zone is stated; whether day and month can be confused."""
    form = draw.one("date_form", _DATES[spelling.language])
    zone = draw.one("zone_by", ["offset", "line", ""], [2, 1, 3])
    confused = form.startswith(("%d/", "%m/")) and wall.day <= 12
    apart = draw.yes("date_apart", 0.4) and "T" not in form
    suffix = wall.strftime("%z") if zone == "offset" else ""
    suffix = "Z" if suffix == "+0000" else f"{suffix[:3]}:{suffix[3:]}" if suffix else ""
    if apart:
        date, _, clock = form.partition(" ")
        lines = [
            (spelling.word(draw, "date"), wall.strftime(date)),
            (spelling.word(draw, "time"), wall.strftime(clock) + suffix),
        ]
    else:
        lines = [(spelling.word(draw, "start"), wall.strftime(form) + suffix)]
    if zone == "line":
        name = str(wall.tzinfo)
        if name != "UTC" and draw.yes("zone_as_offset", 0.5):
            name = "UTC+1" if wall.strftime("%z") == "+0100" else "UTC+2"
        lines.append((spelling.word(draw, "zone"), name))
    return lines, bool(zone), confused


def speed_line(draw: Draw, spelling: Spelling) -> tuple[str, str]:
    """Return key and value of the speed of the shaft."""
    unit = draw.one(
        "speed_unit", {"en": ["rpm", "1/min"], "de": ["1/min", "U/min"], "fr": ["tr/min"]}[spelling.language]
    )
    return spelling.word(draw, "speed"), f"{60 * SPEED_HZ:.0f} {unit}"
