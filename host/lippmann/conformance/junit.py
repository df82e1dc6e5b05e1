"""Write the verdicts of `lippmann regress` as JUnit XML for continuous integration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

from lippmann.base.files import replacing
from lippmann.conformance.judge import Verdict
from lippmann.errors import printable


def write_junit(
    path: Path, verdicts: Sequence[tuple[str, Verdict]], ended: str | None, about: Mapping[str, str]
) -> None:
    """Write one test case per ray set; `ended` is the error if the stream ended early.

    `about` contains suite properties. Raises InputError if the file cannot be written.
    """
    wrong = [None if one.right else ("failure", one.stage or "", one.headline, one.lines) for _, one in verdicts]
    cases = [(name, problem) for (name, _), problem in zip(verdicts, wrong, strict=True)]
    errors = [] if ended is None else [("stream", ("error", "stream", ended, list[str]()))]
    failures = sum(problem is not None for problem in wrong)
    counts = {"tests": str(len(cases + errors)), "failures": str(failures), "errors": str(len(errors))}
    top = Element("testsuites", counts)
    suite = SubElement(top, "testsuite", {"name": "lippmann regress", **counts, "skipped": "0"})
    if about:
        properties = SubElement(suite, "properties")
        for name, value in about.items():
            SubElement(properties, "property", {"name": name, "value": printable(value)})
    for name, problem in [*cases, *errors]:
        attributes = {"classname": f"lippmann.{name.partition('/')[0]}", "name": name}
        case = SubElement(suite, "testcase", attributes)
        if problem is not None:
            kind, stage, message, lines = problem
            entry = SubElement(case, kind, {"type": stage, "message": printable(message)})
            entry.text = printable("\n".join(lines)) or None
    indent(top)
    with replacing(path) as partial:
        ElementTree(top).write(partial, "utf-8", xml_declaration=True)
