"""All hand-made hostile inputs."""

from hostile.cases import Case
from hostile.documents import document_cases, value_cases
from hostile.ledger_cases import ledger_cases
from hostile.table_cases import table_cases
from hostile.tensor_cases import tensor_cases
from hostile.text_cases import mesh_cases, text_cases, urdf_cases


def corpus() -> list[Case]:
    """All cases, in a fixed order."""
    made = (document_cases, value_cases, table_cases, tensor_cases, ledger_cases, text_cases, mesh_cases, urdf_cases)
    return [case for cases in made for case in cases()]
