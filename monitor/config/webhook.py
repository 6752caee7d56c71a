"""Templates of the JSON that a webhook posts: ready ones for chat services, or Jinja of the plant's own."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

READY = {
    "slack": """{"text": {{ ("*" ~ (title | slack) ~ "*\\n```" ~ (text | slack) ~ "```") | tojson }}}""",
    "mattermost": """{"username": "spallwatch",
 "text": {{ ("#### " ~ title ~ "\\n```\\n" ~ text ~ "\\n```" ~ ("\\n" ~ page if page else "")) | tojson }}}""",
    "teams": """{"type": "message", "attachments": [{
  "contentType": "application/vnd.microsoft.card.adaptive",
  "content": {"$schema": "http://adaptivecards.io/schemas/adaptive-card.json", "type": "AdaptiveCard", "version": "1.4",
   "body": [
    {"type": "TextBlock", "weight": "Bolder", "wrap": true, "text": {{ title | tojson }}},
    {%- for line in (headline, sureness, level, action) if line %}
    {"type": "TextBlock", "wrap": true, "text": {{ line | tojson }}},
    {%- endfor %}
    {"type": "TextBlock", "wrap": true, "fontType": "Monospace", "text": {{ text | tojson }}}]
   {%- if page %}, "actions": [{"type": "Action.OpenUrl", "title": "Page", "url": {{ page | tojson }}}]
   {%- endif %}}}]}""",
    "apprise": """{"title": {{ title | tojson }}, "body": {{ text | tojson }}, "format": "text",
 "type": "{{ {"danger": "failure", "alert": "warning"}.get(severity, "info") }}"}""",
}
"""Slack, Mattermost, a workflow of Microsoft Teams, and a server of the Apprise API."""
TEXTS = ("title", "text", "machine", "page", "severity", "headline", "sureness", "level", "action")
"""Fields of a template that are texts, "" where there is nothing to say; besides, ``events`` and ``left_out``."""
_SLACK = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;"})
_EVENT = {
    "kind": "alarm_raised",
    "severity": "danger",
    "channel": "horizontal",
    "source": "acq",
    "id": "17",
    "block": 1234,
    "time_utc": "2026-11-21T14:04:05.000Z",
    "text": 'danger: "RMS" is 3.21 g\\, above the level <of> 3 g & more',
}
_SAMPLES: tuple[dict[str, Any], ...] = (
    {**dict.fromkeys(TEXTS, 'a "word" <&> \\ 1\n2'), "severity": "danger", "events": [_EVENT], "left_out": 2},
    {**dict.fromkeys(TEXTS, ""), "severity": "info", "events": [], "left_out": 0},
)


class WebhookTemplate:
    """A template that has rendered JSON of a message with everything, and of one with nothing."""

    def __init__(self, given: str) -> None:
        """Compile a template: a name of :data:`READY`, or Jinja.

        Raises:
            ValueError: it is neither, or what it renders is no JSON; with the line.
        """
        from jinja2 import StrictUndefined, TemplateSyntaxError
        from jinja2.sandbox import ImmutableSandboxedEnvironment

        if "{" not in given and given not in READY:
            raise ValueError(
                f"template: expected one of {', '.join(READY)}, or a JSON text with {{{{ title | tojson }}}}"
            )
        environment = ImmutableSandboxedEnvironment(undefined=StrictUndefined, autoescape=False)
        environment.filters["tojson"] = _to_json
        environment.filters["slack"] = lambda text: str(text).translate(_SLACK)
        try:
            self._template = environment.from_string(READY.get(given, given))
        except TemplateSyntaxError as error:
            raise ValueError(f"template, line {error.lineno}: {error.message}") from None
        for sample in _SAMPLES:
            self.render(sample)

    def render(self, fields: Mapping[str, Any]) -> str:
        """Return the JSON of a message.

        Raises:
            ValueError: it cannot be rendered, or is no JSON.
        """
        from jinja2 import TemplateError

        try:
            text = self._template.render(fields)
        except (TemplateError, TypeError, ValueError, ArithmeticError, LookupError, AttributeError) as error:
            raise ValueError(f"template: {type(error).__name__}: {error}") from None
        try:
            json.loads(text)
        except ValueError as error:
            line = getattr(error, "lineno", 1)
            found = (text.splitlines() or [""])[line - 1].strip()[:60]
            raise ValueError(
                f"template: renders no JSON ({error}), line {line} is {found!r}; texts need {{{{ ... | tojson }}}}"
            ) from None
        return text


def _to_json(value: Any) -> str:
    """Return a value as JSON; a field that does not exist raises what names it."""
    from jinja2 import Undefined

    return json.dumps(str(value) if isinstance(value, Undefined) else value, allow_nan=False)
