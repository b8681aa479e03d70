"""Present the layer plans of the objects of a plate, if they have several, as facts for JSON and as sentences."""

from __future__ import annotations

from typing import Any

from printer_slicer.surface import Certificate
from printer_slicer.texts import format_significant

__all__ = ["collect_stack_facts", "format_stack_sentences"]


def collect_stack_facts(certificate: Certificate) -> list[dict[str, Any]]:
    """Return for JSON the layers and the certificate of each stack; an empty list if all objects have the same layers.

    Args:
        certificate: of the whole plate.
    """
    return [
        {
            "objects": one.name,
            "layers": one.plan.n_layers,
            "heights": [[count, height] for count, height in one.plan.runs()],
            "max_error_mm": round(one.max_error, 6),
            "mean_error_mm": round(one.mean_error, 6),
            "volume_error_mm3": round(one.volume_error, 3),
            "height_error_mm": round(one.overshoot - one.missing, 6),
        }
        for one in certificate.parts
    ]


def format_stack_sentences(facts: list[dict[str, Any]]) -> list[str]:
    """Format layers and certificate of each stack, one sentence each.

    Args:
        facts: the result of `collect_stack_facts`.
    """
    return [
        f"{one['objects']}: {one['layers']} layers, deviation at most {format_significant(one['max_error_mm'])} mm, "
        f"volume error at most {format_significant(one['volume_error_mm3'])} mm³"
        for one in facts
    ]
