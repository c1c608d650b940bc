"""Templates: text is escaped, a missing value is refused, JSON cannot end its element."""

import json

import jinja2
import pytest
from markupsafe import Markup

from unwrinkle.viewer.pages import filled_page


def panel(**values: object) -> str:
    return filled_page("unwrinkle.logs", "panel.html", **values)


def overlay(views: list[str], data: object) -> str:
    names = ("title", "short", "hash", "verdict", "facts", "steps", "layers")
    values = dict.fromkeys(names, "")
    return filled_page("unwrinkle.viewer", "overlay.html", **values, views=views, data=data)


def test_text_is_escaped_and_markup_is_not() -> None:
    page = panel(title="<b>&", facts=[Markup("<i>a</i>")], rows=[("1 s", "x", "{{ title }}")])
    assert "&lt;b&gt;&amp;" in page
    assert "<div><i>a</i></div>" in page
    assert "<td>{{ title }}</td>" in page


def test_a_missing_value_is_refused() -> None:
    with pytest.raises(jinja2.UndefinedError):
        panel(title="a", rows=[])


def test_json_in_a_page_cannot_end_its_element_and_keeps_the_order() -> None:
    values = {"z": "</script><script>alert(1)", "a": [1.5, None]}
    page = overlay(["<v>"], values)
    text = page.partition('id="plan-data">')[2].partition("</script>")[0]
    assert json.loads(text) == values
    assert list(json.loads(text)) == ["z", "a"]
    assert "<v>" not in page
    with pytest.raises(ValueError, match="JSON"):
        overlay([], {"a": float("nan")})
