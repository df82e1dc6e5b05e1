"""A page's elements and texts, for the tests of what writes HTML."""

from html.parser import HTMLParser

#: Elements that have no end tag.
VOID = {"meta", "img", "link", "br", "hr", "input"}


class HtmlPage(HTMLParser):
    """Elements with their attributes, the first text of each id, the texts of captions; whether each end tag fits."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, str] = {}
        self.captions: dict[str, list[str]] = {"figcaption": [], "caption": []}
        self.well_formed = True
        self._open: list[tuple[str, str | None]] = []
        self.feed(page)
        self.close()
        self.well_formed &= not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append((tag, dict(attrs).get("id")))
        if tag in self.captions:
            self.captions[tag].append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        self.well_formed &= bool(self._open) and self._open.pop()[0] == tag

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1][1]:
            self.texts.setdefault(self._open[-1][1], data)
        for tag, _ in self._open:
            if tag in self.captions:
                self.captions[tag][-1] += data

    def named(self, *tags: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name in tags]

    def values(self, *keys: str) -> list[str]:
        return [attributes[key] or "" for _, attributes in self.elements for key in keys if attributes.get(key)]
