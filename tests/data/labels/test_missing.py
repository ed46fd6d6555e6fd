from tactileforge.data.labels.missing import stated


def test_words_that_programs_write_for_no_value() -> None:
    for word in ("", " ", "nan", "NaN", "None", "NULL", "NA", "n/a", "#N/A", "<NA>", "?", "-"):
        assert stated(word) == "", word
    assert stated(None) == ""
    assert stated(float("nan")) == ""
    assert [stated(word) for word in ("nano", "0", " bolt ", "a-b")] == ["nano", "0", "bolt", "a-b"]
