"""The metrics of a row of results for the rubric."""

from dcap.evaluation.judging.rubric import SCALES, Metrics
from dcap.evaluation.outcome_table import SampleOutcome


def row_metrics(row: SampleOutcome) -> Metrics:
    """Metrics by the rubric's names. Whether the centre of mass is over its support is only a prediction: if the
    referee continued the simulation, its outcome counts instead."""
    found = {name: getattr(row, name) for axis in SCALES.values() for name in axis}
    return found if row.referee_drift_deg is None else found | {"com_supported": None}
