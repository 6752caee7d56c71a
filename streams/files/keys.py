"""Spellings of what files state: the keys of a quantity, and the units in which it is written."""

from __future__ import annotations

import re

_PREFIXES = {"": 1.0, "m": 1e-3, "u": 1e-6}
_LENGTHS = {"mm": 1e-3, "um": 1e-6, "cm": 1e-2, "m": 1.0, "km": 1e3, "in": 0.0254, "ft": 0.3048}
_VOLTS = {f"{prefix}v": size for prefix, size in _PREFIXES.items()}
_SI = [f"m{power}" for power in ("/s2", "s-2", "/s/s", "/ss")]
UNITS: dict[str, tuple[str, float]] = {
    **{f"{prefix}{g}": ("g", size) for prefix, size in _PREFIXES.items() for g in ("g", "gn", "g_n", "g0", "gravity")},
    **{
        f"{length}{power}": ("m/s2", size)
        for length, size in _LENGTHS.items()
        for power in ("/s2", "s-2", "/s/s", "/ss")
    },
    "gal": ("m/s2", 1e-2),
    **{f"{length}{power}": ("mm/s", 1e3 * size) for length, size in _LENGTHS.items() for power in ("/s", "s-1")},
    "ips": ("mm/s", 25.4),
    **{word: ("V", size) for word, size in _VOLTS.items()},
    "unknown": ("unknown", 1.0),
}
"""By plain spelling (:func:`streams.files.statements.plain_unit`): the unit of ours of which each is a multiple."""
RATES = ("rate", "samplerate", "samplingrate", "samplingfrequency", "samplefrequency", "samplefreq", "samplingfreq",
          "fs", "fsample", "abtastrate", "abtastfrequenz", "messrate", "scanrate", "acquisitionrate", "datarate",
          "outputdatarate", "odr", "samplespersecond", "samplespersec", "sps", "frequencedechantillonnage",
          "frequenceechantillonnage", "frecuenciademuestreo", "frequenzadicampionamento",
          "frequenzacampionamento", "tauxdechantillonnage", "サンプリング周波数",
          "czestotliwoscprobkowania", "vzorkovacifrekvence", "samplingsfrekvens", "bemonsteringsfrequentie",
          "taxadeamostragem", "frequenciadeamostragem", "采样频率", "采样率", "採樣頻率")  # fmt: skip
STEPS = ("dt", "increment", "tinc", "deltat", "deltax",
          "wfincrement", "sampleinterval", "samplinginterval", "sampleperiod",
          "samplingperiod", "timestep", "timeincrement", "timeinterval", "xincrement", "abtastintervall",
          "abtastzeit", "abtastperiode", "periodedechantillonnage", "periodeechantillonnage", "pasdetemps",
          "pasdechantillonnage", "periododemuestreo", "periododicampionamento", "サンプリング周期",
          "okresprobkowania", "采样间隔", "采样周期")  # fmt: skip
HERTZ = {"": 1.0, "hz": 1.0, "khz": 1e3, "mhz": 1e6, "inhz": 1.0, "inkhz": 1e3, "ss": 1.0, "sas": 1.0, "kss": 1e3}
SECONDS = {"": 1.0, "s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "ins": 1.0, "inms": 1e-3, "inus": 1e-6}
FACTORS = {
    **{word + end: ("rate", factor) for word in RATES for end, factor in HERTZ.items()},
    **{word + end: ("step", factor) for word in STEPS for end, factor in SECONDS.items()},
}  # fmt: skip
"""Of a plain key: whether it states a rate or a step, and the factor to Hz or s."""
PLAIN_RATES = frozenset((*RATES, *STEPS)) - {
    *("wfincrement", "deltax", "xincrement", "sps", "samplespersecond", "samplespersec")
}
"""Plain keys whose number may be in kHz, ms or us where no unit is written; formats fix the unit of the others."""
MAX_OPEN_RATE = 64.0
"""Hz up to which a rate without a unit may be one in kHz; up to 300 Hz where it is no whole number."""
STARTS = ("startutc", "start", "starttime", "wfstarttime", "t0", "acquisitiontime", "timestamp", "datetime",
           "startzeit")  # fmt: skip
MOMENTS = (
    *("startdatetime", "starttimeutc", "starttimelocal", "starttimestamp", "startdate", "recordingstart"),
    *("recordingtime", "recordingdate", "recorded", "recordedat", "acquisitionstart", "acquisitiondate", "acquired"),
    *("acquisitiondatetime", "measurementstart", "measurementtime", "measurementdate", "measured", "measuredat"),
    *("triggertime", "testdatetime", "testdate", "dateandtime", "datetimeutc", "date", "time", "utc"),
    *("messbeginn", "messstart", "messzeit", "messzeitpunkt", "messdatum", "messungvom", "beginn", "aufnahmezeit"),
    *("aufnahmebeginn", "aufnahmestart", "aufnahmedatum", "aufnahmezeitpunkt", "aufzeichnungsbeginn"),
    *("aufzeichnungsstart", "startzeitpunkt", "startdatum", "zeitpunkt", "zeitstempel", "datumuhrzeit", "datumzeit"),
    *("datumundzeit", "datumunduhrzeit", "datum", "zeit", "uhrzeit"),
    *("recordingstarted", "acquisitionstarted", "measurementstarted", "started", "debut", "debutdacquisition"),
    *(
        "depart",
        "debutdelamesure",
        "debutdemesure",
        "datededebut",
        "dateheure",
        "inicio",
        "fechayhora",
        "inizio",
        "dataeora",
        "begintime",
        "測定日時",
        "トリガ時刻",
        "采样时间",
        "采集时间",
        "测试时间",
        "测量时间",
        "开始时间",
    ),
)
"""Keys of date and time of day in one; those of ``STARTS`` may state a day alone."""
DATES = ("startdate", "date", "recordingdate", "acquisitiondate", "measurementdate", "testdate", "startdatum", "datum",
          "messdatum", "aufnahmedatum", "jour", "fecha", "data", "datapomiaru", "日期", "日付")  # fmt: skip
CLOCKS = ("starttime", "time", "recordingtime", "acquisitiontime", "measurementtime", "testtime", "startzeit",
          "uhrzeit", "messzeit", "aufnahmezeit", "zeit", "messbeginn", "timeofday", "heure", "hora", "ora",
          "godzina", "czas", "czaspomiaru", "時刻")  # fmt: skip
UNIT_KEYS = ("unit", "units", "unitstring", "niunitdescription", "engineeringunits", "einheit", "messeinheit", "yunit",
              "yunits", "yunitlabel", "unitlabel", "yaxisunit", "yaxisunits", "signalunit", "channelunit", "dataunit",
              "dataunits", "physicalunit", "unitofmeasure", "unite", "unidad", "unita", "単位",
              "单位", "jednostka", "valueunit")  # fmt: skip
TIME_KEYS = frozenset((*STARTS, *MOMENTS, *DATES, *CLOCKS))
"""Plain keys of dates and times of day."""
ZONE_KEYS = {
    word + end: unit
    for word in ("timezone", "zeitzone", "tz", "utcoffset", "timezoneoffset", "fuseauhoraire", "zonahoraria",
                 "fusoorario", "gmtoffset", "tzoffset", "offsetutc", "offsetfromutc", "offsettoutc", "offsetfromgmt",
                 "utcdifference", "gmtdifference", "timedifference", "zeitverschiebung", "utcversatz", "decalageutc",
                 "timezonename", "timezoneid", "tzname", "localtimezone")
    for end, unit in (("", ""), ("h", "h"), ("hours", "h"), ("hrs", "h"), ("min", "min"), ("minutes", "min"),
                      ("s", "s"), ("sec", "s"), ("seconds", "s"))
}  # fmt: skip
"""Plain keys of the zone of times, each with the unit of an offset that the key names."""
SUMMER_KEYS = ("dst", "isdst", "daylightsaving", "daylightsavings", "daylightsavingtime", "summertime", "sommerzeit",
               "heuredete", "horariodeverano", "oralegale")  # fmt: skip
"""Plain keys that say whether it is summer time."""
DECIMATIONS = ("decimation", "decimationfactor", "decimate", "downsampling", "downsamplingfactor", "downsample",
               "subsampling", "subsamplingfactor", "dezimation", "dezimierung", "ratedivider", "sampleratedivider",
               "clockdivider", "diezmado", "decimazione")  # fmt: skip
"""Plain keys of a number that a stated rate may have to be divided by."""
PULSE_KEYS = ("pulsesperrevolution", "pulsesperrev", "ppr", "impulseproumdrehung")
"""Plain keys of the pulses of a whole turn."""
SPEED_UNITS = {
    **dict.fromkeys(("rpm", "1/min", "min-1", "/min", "u/min", "upm", "tr/min", "r/min", "rev/min"), 1.0 / 60.0),
    "obr/min": 1.0 / 60.0,
    **dict.fromkeys(("hz", "1/s", "rps"), 1.0),
}
LOAD_UNITS = {"n": 1.0, "kn": 1e3}
LEVEL_UNITS: dict[str, dict[str, float]] = {
    "g": {
        f"{volts}/{per}": 1e3 * size * of_one_g
        for volts, size in _VOLTS.items()
        for per, of_one_g in (("g", 1.0), ("gn", 1.0), *((si, 9.80665) for si in _SI))
    },
    "mm/s": {
        text: 1e3 * size / of_one
        for volts, size in _VOLTS.items()
        for per, (own, of_one) in UNITS.items()
        if own == "mm/s"
        # Of geophones: V·s/m, which is plain as vs/m.
        for text in (f"{volts}/{per}", *([f"{volts}s/{per.removesuffix('/s')}"] if per.endswith("/s") else ()))
    },
}
"""By the quantity of a sensor: mV per g or mm/s of a unit of its sensitivity."""
SPEEDS = {
    **dict.fromkeys(("speed", "shaftspeed", "rotationalspeed", "rotationspeed", "rotatingspeed", "motorspeed"), ""),
    **dict.fromkeys(("runningspeed", "runspeed", "drehzahl", "wellendrehzahl", "motordrehzahl", "vitesse"), ""),
    **dict.fromkeys(("predkoscobrotowa", "obroty", "转速", "回転数", "回転速度"), ""),
    **dict.fromkeys(("rpm", "speedrpm", "shaftspeedrpm", "drehzahlrpm"), "rpm"),
    **dict.fromkeys(("speedhz", "shaftspeedhz"), "hz"),
}
LOADS = {
    **dict.fromkeys(("load", "radialload", "force", "radialforce", "radiallast", "radialkraft", "kraft"), ""),
    "loadnewton": "n",
    "loadn": "n",
    "loadkn": "kn",
}
LEVELS = {
    **dict.fromkeys(("sensitivity", "sensorsensitivity", "transducersensitivity", "empfindlichkeit"), ""),
    **dict.fromkeys(("sensibilite", "sensibilidad", "sensibilita", "感度", "灵敏度", "czulosc"), ""),
    **dict.fromkeys(("sensitivitymvperg", "sensitivitymvg"), "mv/g"),
    **dict.fromkeys(("sensitivitymvpermms", "sensitivitymvmms"), "mv/mm/s"),
}
"""Plain keys of speed, load and sensitivity, each with the unit that the key names: without one the value must."""
GAINS = frozenset(
    word + end
    for word in ("gain", "amplifiergain", "ampgain", "preampgain", "preamplifiergain", "inputgain", "channelgain",
                 "analoggain", "sensorgain", "hardwaregain", "iepegain", "icpgain", "conditionergain", "amplification",
                 "amplificationfactor", "gainfactor", "verstarkung", "verstaerkung", "verstarkungsfaktor", "ganancia",
                 "guadagno")
    for end in ("", "db")
)  # fmt: skip
MULTIPLIERS = frozenset(("multiplier", "ymultiplier", "ymult", "yfactor", "yscalefactor", "verticalmultiplier",
                         "multiplikator", "conversionfactor", "umrechnungsfaktor"))  # fmt: skip
ATTENUATIONS = frozenset(word + end for word in ("probe", "probeattenuation", "attenuation", "attenuationfactor",
                         "probefactor", "tastkopf", "dampfung", "abschwachung") for end in ("", "db"))  # fmt: skip
"""Plain keys of an amplifier before the converter, of what numbers may have to be multiplied by, and of a divider."""
SCALES: dict[str, str] = dict.fromkeys(
    (
        *("scale", "scalefactor", "scaling", "resolution", "lsb", "lsbsize", "countscale", "sensitivity"),
        "empfindlichkeit",
    ),
    "",
)
COUNT = ("lsb", "count", "counts", "digit", "digits", "bit")
SCALE_UNITS = {
    f"{unit}/{count}": size
    for count in COUNT
    for unit, size in (
        *(("g", 1.0), ("mg", 1e-3), ("ug", 1e-6)),
        *((si, 1.0 / 9.80665) for si in _SI),
    )
}
PER_G = {f"{count}/g": 1.0 for count in COUNT} | {f"{count}/mg": 1e3 for count in COUNT}
"""Units of a count in g, and of counts in one g."""
KEYS = frozenset((*FACTORS, *TIME_KEYS, *ZONE_KEYS, *SUMMER_KEYS, *DECIMATIONS,
                  *UNIT_KEYS, *PULSE_KEYS, *SPEEDS, *LOADS, *GAINS, *MULTIPLIERS, *ATTENUATIONS,
                  *LEVELS, *SCALES))  # fmt: skip
"""Plain keys that may state rate, unit, start, sensitivity, speed, load or pulses a revolution."""
OTHER_UNITS = frozenset(
    (*("pa", "kpa", "hpa", "mpa", "bar", "mbar", "psi", "°c", "degc", "°f", "k", "a", "ma", "w", "kw", "n", "kn", "nm"),
     *("%", *SPEED_UNITS, "mm", "um", "mil", "l/min", "m3/h", "ge", "gse"))
)  # fmt: skip
"""Units behind a name that are none of a vibration."""
DISPLACEMENTS = frozenset(("mm", "um", "micron", "microns", "mil", "mils", "nm", "in"))
"""Units of a vibration that is neither an acceleration nor a velocity."""
LIKE_RATE = {
    "": 1.0,
    **{
        f"{prefix}{unit}": size
        for unit in ("hz", "s/s", "sps", "sa/s", "samples/s", "scans/s")
        for prefix, size in (("", 1.0), ("k", 1e3), ("m", 1e6))
    },
    "1/s": 1.0,
    "k": 1e3,
}
LIKE_STEP = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
TIME_UNITS = {**LIKE_STEP, "min": 60.0, "h": 3600.0, "d": 86400.0, "days": 86400.0, "minutes": 60.0, "hours": 3600.0}
"""Units of a column of times in s."""
MONTH_NAMED = r"\d{1,2}[- ][A-Za-z]{3,9}[- ](?:\d{4}|\d\d)|[A-Za-z]{3,9} \d{1,2}, \d{4}"
UNIT_IN_NAME = re.compile(r"^(.*?)\s*[\[(]([^\])]*)[\])]\s*$")
"""A name with its unit behind it."""
NUMBER = re.compile(r"\s*([-+]?(?:\d[\d.,]*|[.,]\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")
GROUPING_BLANKS = re.compile("(?<=\\d)[ \N{NO-BREAK SPACE}\N{NARROW NO-BREAK SPACE}](?=\\d{3}(?:\\D|$))")
GROUPS = re.compile(r"[-+]?\d{1,3}([.,])\d{3}")
