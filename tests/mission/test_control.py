import json
from datetime import datetime

from server.mission.control import _records_on_disk
from server.store.runs import RunFolder


def test_a_capture_that_was_running_when_the_console_ended_is_interrupted(tmp_path):
    run = RunFolder.create(tmp_path, "bin")
    run.write_state(
        {
            "request": {"mode": "standard", "pictures": 8},
            "started_at": "2026-01-02T03:04:05+00:00",
            "status": {
                "id": run.id,
                "state": "running",
                "phase": "fly",
                "progress": 0.4,
                "eta_s": 60.0,
                "run": "/elsewhere",
                "error": None,
                "mode": "standard",
                "round_index": 1,
                "rounds": 2,
                "images": 4,
                "images_total": 8,
                "at": "2026-01-02T03:05:05+00:00",
            },
        }
    )
    (run.path / "metrics.json").write_text(json.dumps({"psnr_db": 21.0}))
    record = _records_on_disk(tmp_path)[run.id]
    assert record.status.state == "interrupted"
    assert record.status.run == str(run.path)
    assert isinstance(record.status.at, datetime)
    assert record.request.pictures == 8
    assert record.metrics == {"psnr_db": 21.0}
