"""The part of a report on attempts that do not count, and on records that were made with different versions."""

from collections import Counter
from collections.abc import Sequence

from cutgrammar.results.report import Cell, Row, Section, Table, columns, keys, words
from cutgrammar.storage.attempts import FAULT, AttemptSummary, differing_versions

MEANINGS = {FAULT: "fault of the machine: repeated, and no score"}
"""What the reader must know of statuses that no record has."""


def provenance_sections(summaries: Sequence[AttemptSummary], machine: bool = True) -> tuple[Section, ...]:
    """The section, or none where all records were made in one way at the first attempt.

    Args:
        summaries: of the ledgers.
        machine: also count faults of the machine, which are never the same twice.
    """
    differing = differing_versions([versions for summary in summaries for versions in summary.versions])
    superseded: Counter[str] = Counter()
    for summary in summaries:
        superseded.update({status: n for status, n in summary.superseded.items() if machine or status != FAULT})
    items = []
    if differing:
        cells = [(name, version, n) for name, counts in differing.items() for version, n in sorted(counts.items())]
        rows = tuple(Row((Cell(name), Cell(version, is_code=True), Cell(n, "d"))) for name, version, n in cells)
        note = "The rows of the tables above were not all made with the same code; evaluate again where that matters."
        items.append(Table("Versions that differ", (*keys("of"), *words("version"), *columns("records")), rows, note))
    if superseded:
        rows = tuple(
            Row((Cell(MEANINGS.get(status, f"{status}, and carried out again")), Cell(n, "d")))
            for status, n in sorted(superseded.items())
        )
        items.append(Table("Attempts that do not count", (*keys("ended"), *columns("attempts")), rows))
    return (Section("Attempts and versions", tuple(items)),) if items else ()
