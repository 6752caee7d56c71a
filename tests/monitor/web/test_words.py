"""The page's words come from monitor/words: they stand in its HTML as data, and its scripts hold no copy."""

from __future__ import annotations

import json
import re
from pathlib import Path

import monitor.web.app as app
from monitor.health.alarms import machine_state
from monitor.health.schema import EDV_STATUSES, STATUSES, TT_STATUSES
from monitor.words import statuses
from monitor.words.statuses import page_words

STATIC = Path(app.__file__).parent / "static"


def test_the_page_holds_the_words_as_data() -> None:
    html = app._content(STATIC / "index.html").decode("utf-8")
    (data,) = re.findall(r'<script type="application/json" id="words">(.*?)</script>', html)
    assert json.loads(data) == json.loads(json.dumps(page_words()))
    assert "<" not in data


def test_no_script_repeats_a_sentence() -> None:
    scripts = "".join(path.read_text(encoding="utf-8") for path in STATIC.glob("*.js"))
    tables = (statuses.EDV_REFUSALS, statuses.TT_REFUSALS, statuses.TTA_REFUSALS, statuses.STATUS_MEANINGS)
    sentences = [text for table in tables for text in table.values() if " " in text]
    sentences += [meaning for _, meaning in statuses.STATES.values() if " " in meaning]
    assert not [text for text in sentences if f'"{text}"' in scripts]


def test_every_status_has_its_words() -> None:
    words = page_words()
    assert set(words["edv"]) == set(EDV_STATUSES) - {"ok"}
    assert set(words["tt"]) == set(TT_STATUSES) - {"ok"}
    assert set(words["blocks"]) == set(STATUSES)
    order = list(statuses.STATES)
    assert [machine_state(*order[place:]) for place in range(len(order))] == order
