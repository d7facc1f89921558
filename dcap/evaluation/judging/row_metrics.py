"""The metrics of a row of results as the rubric takes them."""

from dcap.evaluation.judging.rubric import SCALES, Metrics
from dcap.evaluation.outcome_table import SampleOutcome


def row_metrics(row: SampleOutcome) -> Metrics:
    """Metrics by the rubric's names. Whether the centre of mass is over what carries it is a forecast: where the state
    was simulated on by the referee, what came of it counts, which may be a tenth of a degree."""
    found = {name: getattr(row, name) for axis in SCALES.values() for name in axis}
    return found if row.referee_drift_deg is None else found | {"com_supported": None}
