import numpy as np
from tactileforge_example.dataset import DummyPresses

from tactileforge.testing import check


def test_conformance():
    results = check("dataset", "dummy_presses")
    assert not [result for result in results if result.status == "failed"], results


def test_deeper_presses_touch_more_and_push_more():
    recording = next(DummyPresses().recordings("train"))
    start, middle = recording.frames.read([0, 20]).astype(int)
    background = recording.no_contact.read([0])[0]
    assert np.abs(start - background).max() == 0
    assert np.abs(middle - background).max() > 20
    assert recording.force[:, 2].argmax() in (19, 20)


def test_every_fourth_recording_is_for_validation():
    dataset = DummyPresses(count=8)
    assert [len(list(dataset.recordings(split))) for split in ("train", "val")] == [6, 2]
