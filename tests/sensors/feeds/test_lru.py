"""Names that strangers invent make nobody forget the ones in use."""

from sensors.feeds.lru import LruCache


def test_the_longest_unused_name_is_forgotten_first() -> None:
    recent: LruCache[int] = LruCache(most=3)
    for number, name in enumerate("abc"):
        assert recent.put(name, number) is None
    assert recent.get("a") == 0

    assert recent.put("d", 3) == 1

    assert (recent.get("b"), "a" in recent, list(recent.values())) == (None, True, [2, 0, 3])


def test_a_name_in_use_outlives_any_number_of_invented_ones() -> None:
    recent: LruCache[int] = LruCache(most=10)
    recent.put("unit", 1)
    for number in range(1000):
        recent.put(f"invented {number}", number)
        assert recent.get("unit") == 1
    assert len(list(recent.values())) == 10
