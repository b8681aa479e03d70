"""Record where the simulated printer extrudes while it executes a job."""

from __future__ import annotations

from array import array

import numpy as np

from printer_slicer.inspection.deposition.marks import marks_of
from printer_slicer.inspection.deposition.record import Deposition
from printer_slicer.inspection.deposition.recorder import DepositionRecorder
from printer_slicer.inspection.deposition.support_gaps import SupportGaps
from printer_slicer.inspection.dry_run.comparison import Comparison
from printer_slicer.jobs import Job
from printer_slicer.profile import Profile
from printer_slicer.sim.move_log import COLUMNS, MoveLog

__all__ = ["DepositionObserver"]


class DepositionObserver:
    """Records where a simulated printer extrudes while it executes a job.

    Args:
        job: the job.
        profile: the profile with the machine and the material.
        comparison: maps executed commands to commands of the job.

    Attributes:
        move_log: the log to pass to the printer.
    """

    def __init__(self, job: Job, profile: Profile, comparison: Comparison) -> None:
        self.move_log = MoveLog(self._record_moves)
        self._comparison = comparison
        area = profile.material.filament_area
        self._recorder = DepositionRecorder(
            profile.printer.corners,
            area,
            profile.max_flow,
            marks_of(job.commands, job.text, job.marks, job.roles, SupportGaps.of(profile)),
            profile.printer.head_shapes,
            nozzle_flat=profile.printer.nozzle_flat,
        )

    def finish(self) -> Deposition:
        """Return the recorded extrusion."""
        self.move_log.flush()
        return self._recorder.close()

    def _record_moves(self, rows: array[float], seconds: array[float], clogged_share: float) -> None:
        table = np.frombuffer(rows).reshape(-1, COLUMNS).copy()
        table[:, 0] = self._comparison.commands_of(table[:, 0].astype(np.int64)) + 1
        self._recorder.add_moves(table, np.frombuffer(seconds), clogged_share)
