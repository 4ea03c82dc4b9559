"""Names that strangers invent make nobody forget the ones in use."""

from sensors.bounded_dict import BoundedDict


def test_the_longest_unused_name_is_forgotten_first() -> None:
    recent: BoundedDict[str, int] = BoundedDict(most=3)
    for number, name in enumerate("abc"):
        assert recent.put(name, number) is None
    assert recent.renewed("a") == 0

    assert recent.put("d", 3) == 1

    assert (recent.renewed("b"), "a" in recent, list(recent.values())) == (None, True, [2, 0, 3])


def test_a_name_in_use_outlives_any_number_of_invented_ones() -> None:
    recent: BoundedDict[str, int] = BoundedDict(most=10)
    recent.put("unit", 1)
    for number in range(1000):
        recent.put(f"invented {number}", number)
        assert recent.renewed("unit") == 1
    assert len(list(recent.values())) == 10
