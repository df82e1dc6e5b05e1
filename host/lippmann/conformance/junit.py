"""Verdicts as JUnit XML, which continuous integration shows: a test case for each set of rays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from lippmann.base.files import replacing
from lippmann.conformance.judge import Verdict
from lippmann.errors import printable


def write_junit(
    path: Path,
    verdicts: Sequence[tuple[str, Verdict]],
    ended: str | None,
    about: Mapping[str, str],
) -> None:
    """Write the verdict on each set, by name; `ended` says why there are no more, which is an error there.

    `about` are the suite's properties: what was judged, and how.

    Raises InputError as `files.replacing` for a file that cannot be written.
    """
    wrong = sum(not verdict.right for _, verdict in verdicts)
    errors = int(ended is not None)
    counts = {"tests": str(len(verdicts) + errors), "failures": str(wrong), "errors": str(errors)}
    top = ElementTree.Element("testsuites", counts)
    suite = ElementTree.SubElement(top, "testsuite", {"name": "lippmann regress", **counts, "skipped": "0"})
    if about:
        properties = ElementTree.SubElement(suite, "properties")
        for name, value in about.items():
            ElementTree.SubElement(properties, "property", {"name": name, "value": printable(value)})
    for name, verdict in verdicts:
        case = _case(suite, name)
        if not verdict.right:
            failure = ElementTree.SubElement(
                case, "failure", {"type": verdict.stage or "", "message": printable(verdict.headline)}
            )
            failure.text = printable("\n".join(verdict.lines))
    if ended is not None:
        ElementTree.SubElement(_case(suite, "stream"), "error", {"type": "stream", "message": printable(ended)})
    ElementTree.indent(top)
    with replacing(path) as partial:
        ElementTree.ElementTree(top).write(partial, "utf-8", xml_declaration=True)


def _case(suite: ElementTree.Element, name: str) -> ElementTree.Element:
    case = name.partition("/")[0]
    return ElementTree.SubElement(suite, "testcase", {"classname": f"lippmann.{case}", "name": name})
