"""Counts of work: the same again for the same work, and what has grown is named."""

import json

import pytest

from scripts.counted_work import KEPT, counted, grown, jobs, rendered, slab


@pytest.mark.slow
def test_the_same_work_counts_the_same_and_more_of_it_more():
    def counts(paths):
        job = rendered(slab(views=5, tilts=2), paths)
        job(1)
        with counted() as found:
            job(2)
        assert found.pop("calls") > 0  # fewer where something is remembered
        return dict(found)

    once, more = counts(400), counts(600)
    assert counts(400) == once
    assert once.keys() == {"events", "connections", "points"}
    assert [line.split(":")[1].split()[0] for line in grown({"a": more}, {"a": once})].count("events") == 1


def test_what_has_grown_by_more_than_3_percent_is_named():
    before = {"job": {"calls": 100, "events": 100}}
    assert grown({"job": {"calls": 103, "events": 90}}, before) == []
    assert grown({"job": {"calls": 104, "events": 90}}, before) == ["job: calls 100 -> 104"]
    assert grown({"job": {"elements": 1}}, before) == ["job: elements 0 -> 1"]  # work of a new kind


def test_the_kept_counts_are_those_of_all_jobs():
    assert set(json.loads(KEPT.read_text())["counts"]) == set(jobs())
