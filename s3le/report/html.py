"""HTML that escapes by construction: whatever is not Html is text, and text is escaped.

Nothing here knows what a page says. `words` reads the few marks in which this project's own
sentences are written; the values put into them are text like any other.
"""

import html
import re
from collections.abc import Sequence

_VOID = {"img", "meta", "br", "hr"}
_MARKS = (
    (re.compile(r"\*\*(.+?)\*\*"), r"<strong>\1</strong>"),
    (re.compile(r"\*(.+?)\*"), r"<em>\1</em>"),
    (re.compile(r"`(.+?)`"), r"<code>\1</code>"),
)


class Html(str):
    """Markup that may go on a page as it stands."""

    __slots__ = ()


def text(value: object) -> Html:
    """Anything as text; what does not print (also what turns the reading direction) is replaced.

    A lone surrogate does not print either, so the page can always be written as UTF-8.
    """
    if isinstance(value, Html):
        return value
    seen = "".join(c if c.isprintable() or c == "\n" else "\ufffd" for c in str(value))
    return Html(html.escape(seen))


def join(parts: Sequence[object], between: str = "") -> Html:
    """Pieces after each other."""
    return Html(text(between).join(text(part) for part in parts))


def tag(name: str, /, *children: object, **attributes: object) -> Html:
    """One element.

    Args:
        name: of the element.
        children: what is in it; text is escaped.
        attributes: by name, `class_` for class, underscores for hyphens; those that are None or
            False are left out, True stands without a value.
    """
    told = ""
    for key, value in attributes.items():
        if value is not None and value is not False:
            own = key.rstrip("_").replace("_", "-")
            told += f" {own}" if value is True else f' {own}="{text(value)}"'
    start = f"<{name}{told}>"
    return Html(start if name in _VOID else f"{start}{join(children)}</{name}>")


def words(template: str, *values: object) -> Html:
    """A sentence of this project's own, with values in its braces.

    Args:
        template: may hold *emphasis*, **strong words** and `code`; otherwise text.
        values: what comes from outside; escaped, and never read as marks.
    """
    made = html.escape(template, quote=False)
    for pattern, into in _MARKS:
        made = pattern.sub(into, made)
    return Html(made.format(*(text(value) for value in values)))


def paragraph(*children: object, kind: str | None = None) -> Html:
    """A paragraph."""
    return tag("p", *children, class_=kind)


def folded(title: object, *children: object) -> Html:
    """What is shown when one asks for it."""
    return tag("details", tag("summary", title), *children)


def scrolled(content: object, name: str) -> Html:
    """Something wide in a box that scrolls by itself, also by keyboard.

    Args:
        content: what is in it.
        name: what a screen reader calls the box.
    """
    return tag("div", content, class_="scroll", tabindex="0", role="region", aria_label=name)


def table(titles: Sequence[object], rows: Sequence[Sequence[object]], numbers: bool = True) -> Html:
    """A table; the first column names its rows.

    Args:
        titles: of the columns; all empty: there is no head.
        rows: cells.
        numbers: the other columns are numbers and stand to the right.
    """
    kind = "n" if numbers else None
    head = tag(
        "thead",
        tag("tr", *(tag("th", title, scope="col", class_=kind if i else None)
                    for i, title in enumerate(titles))),
    )  # fmt: skip
    body = tag(
        "tbody",
        *(
            tag("tr", tag("th", row[0], scope="row"), *(tag("td", c, class_=kind) for c in row[1:]))
            for row in rows
        ),
    )
    told = " / ".join(str(title) for title in titles if title) or "facts"
    parts = [head, body] if any(titles) else [body]
    wordy = "words" if len(titles) > 2 and not numbers else None
    return scrolled(tag("table", *parts, class_=wordy), f"table: {told}")


def gauged(shown: str, share: float) -> Html:
    """A number with a bar before it.

    Args:
        shown: the number.
        share: length of the bar, from 0 to 1 of its room.
    """
    return tag(
        "span", tag("i", aria_hidden="true"), shown,
        class_="gauged", style=f"--share:{100 * share:.1f}%",
    )  # fmt: skip


def explained(content: object, how: object, *more: object) -> Html:
    """A table or picture with the sentence that says how to read it.

    Args:
        content: the table or picture.
        how: the sentence, going on after "How to read it:".
        more: what else is worth knowing, folded.
    """
    caption = tag("p", tag("b", "How to read it: "), how)
    rest = [folded("More about it", *(paragraph(part) for part in more))] if more else []
    return tag("figure", content, tag("figcaption", caption, *rest))
