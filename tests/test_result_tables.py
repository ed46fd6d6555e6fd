"""Tables of two pages are those of their files of results."""

import json

import pytest
import result_tables


@pytest.mark.parametrize(("page", "mark", "results", "table"), result_tables.TABLES)
def test_a_page_has_the_table_of_the_results(page, mark, results, table) -> None:
    text = (result_tables.ROOT / "docs" / page).read_text("utf-8")
    made = table(json.loads((result_tables.RESULTS / results).read_text("utf-8")))
    assert text.count(mark) == 1
    assert result_tables.page_with(text, mark, made) == text, "python benchmarks/result_tables.py"


def test_what_grows_faster_than_the_work_has_a_note() -> None:
    rows = json.loads((result_tables.RESULTS / "growth.json").read_text("utf-8"))["rows"]
    assert len(rows) > 18
    growing = {(row["grows"], row["verb"]) for row in rows if result_tables.needs_note(row)}
    assert growing <= set(result_tables.NOTES)


def test_no_reader_fails_in_another_way_than_by_name() -> None:
    found = json.loads((result_tables.RESULTS / "reader_instead.json").read_text("utf-8"))
    assert len(found) > 60
    for name, row in found.items():
        assert (row["traceback"], row["hang"], row["memory"]) == (0, 0, 0), name


def test_no_damaged_file_ends_in_another_way_than_by_name() -> None:
    found = json.loads((result_tables.RESULTS / "reader_mutants.json").read_text("utf-8"))
    assert sum(row["mutants"] for row in found.values()) > 2000
    for name, row in found.items():
        for way in ("bytes", "structure"):
            held = row.get(way, {})
            assert not any(held.get(one) for one in ("traceback", "hang", "memory")), name
            if row["checksum"] and name != "shards, no index":
                assert not held.get("silent"), name
