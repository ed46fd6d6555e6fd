"""Packets in bytes: published check values, every way to cut a stream, random bytes."""

import random
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactileforge.errors import ConfigError
from tactileforge.sensors.checksums import CHECKSUMS
from tactileforge.sensors.framing import Datagrams, Framing, PacketParser, hex_bytes

FRAMINGS = {
    "checked": Framing(payload=6, header=b"\xaa\x55", checksum="crc16_ccitt"),
    "modbus": Framing(payload=12, header=b"\x20\x4e", checksum="crc16_modbus"),
    "footer": Framing(payload=16, footer=b"\r\n"),
    "header": Framing(payload=8, header=b"\xaa\x55"),
    "both": Framing(payload=5, header=b"$", footer=b"\n"),
    "lengths": Framing(
        payload=40,
        header=b"\xaa\x55",
        checksum="lrc8",
        length_at=0,
        length_format="<H",
        length_plus=2,
    ),
}


def packet(framing, payload):
    checksum = CHECKSUMS[framing.checksum]
    covered = framing.header + payload if framing.covers == "packet" else payload
    return framing.header + payload + checksum.of(covered) + framing.footer


def payloads_of(name, count, seed=0):
    """Payloads without header or footer inside."""
    framing, rng = FRAMINGS[name], random.Random(seed)
    found = []
    while len(found) < count:
        if framing.length_at is None:
            payload = rng.randbytes(framing.payload)
        else:
            body = rng.randbytes(rng.randint(0, 30))
            payload = struct.pack("<H", len(body)) + body
        marks = [mark for mark in (framing.header, framing.footer) if mark]
        whole = packet(framing, payload)
        if all(whole.count(mark) == 1 for mark in marks):
            found.append(payload)
    return found


@pytest.mark.parametrize(
    ("name", "value"),
    [  # of "123456789", as catalogues of CRCs list them; sums by hand
        ("sum8", "dd"),
        ("lrc8", "23"),
        ("xor8", "31"),
        ("crc8", "f4"),
        ("crc16_modbus", "374b"),
        ("crc16_ccitt", "29b1"),
        ("none", ""),
    ],
)
def test_checksums_have_their_published_check_values(name, value):
    assert CHECKSUMS[name].of(b"123456789").hex() == value
    assert CHECKSUMS[name].size == len(value) // 2


def test_a_reply_of_a_real_protocol_is_one_packet():
    """Paxini's serial converter: header, length, ..., complement of the sum of all bytes."""
    reply = bytes.fromhex("aa550d000100fbf0030000030001fd0c39bf")
    parser = PacketParser(FRAMINGS["lengths"])
    assert parser.feed(b"\xaa" + reply + reply[:5]) == [reply[2:-1]]
    wrong = reply[:-1] + b"\xbe"
    assert parser.feed(reply[5:] + wrong + reply) == [reply[2:-1]] * 2
    assert parser.bad == 1
    assert parser.lost == 1 + len(wrong)


@pytest.mark.parametrize("name", FRAMINGS)
@given(data=st.data())
@settings(max_examples=60, deadline=None)
def test_however_a_stream_is_cut_the_same_packets_come(name, data):
    framing = FRAMINGS[name]
    parts = data.draw(
        st.lists(st.one_of(st.binary(max_size=9), st.integers(0, 5)), max_size=12), label="parts"
    )
    sent = payloads_of(name, 6)
    stream = b"".join(
        packet(framing, sent[part]) if isinstance(part, int) else part for part in parts
    )
    whole = PacketParser(framing)
    expected = whole.feed(stream)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8), label="cuts"))
    pieces = [stream[a:b] for a, b in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    parser = PacketParser(framing)
    found = [payload for piece in pieces for payload in parser.feed(piece)]
    assert found == expected
    assert (parser.good, parser.bad, parser.lost) == (whole.good, whole.bad, whole.lost)
    around = sum(len(packet(framing, payload)) for payload in found)
    assert around + parser.lost + parser.waiting == len(stream)


@pytest.mark.parametrize("name", FRAMINGS)
def test_packets_between_noise_are_all_found(name):
    """Every intact packet arrives, unless beside an ambiguous loss."""
    framing = FRAMINGS[name]
    sent = payloads_of(name, 40)
    stream = b"".join(packet(framing, payload) for payload in sent)
    parser = PacketParser(framing)
    found = parser.feed(stream)
    first = 1 if name == "footer" else 0  # what came before the first is not known
    last = len(sent) - (1 if name == "header" else 0)  # and what comes after the last
    assert found == sent[first:last]


@pytest.mark.parametrize("name", sorted(FRAMINGS.keys() - {"lengths"}))  # 8 bits may hold by chance
@pytest.mark.parametrize("seed", range(5))
def test_a_packet_that_lost_bytes_never_counts(name, seed):
    framing, rng = FRAMINGS[name], random.Random(seed)
    sent = payloads_of(name, 60, seed)
    whole, stream = [], b""
    for number, payload in enumerate(sent):
        body = bytearray(packet(framing, payload))
        if number % 5 == 2:
            place = rng.randrange(len(framing.header), len(body) - len(framing.footer))
            del body[place : place + rng.randint(1, 3)]
        else:
            whole.append(payload)
        stream += bytes(body)
    parser = PacketParser(framing)
    found = parser.feed(stream)
    assert set(found) <= set(whole)
    assert len(found) >= len(sent) * 0.55
    assert parser.lost > 0


@pytest.mark.parametrize("name", ["checked", "modbus", "lengths"])
def test_a_million_random_bytes_give_only_packets_whose_checksum_holds(name):
    framing, rng = FRAMINGS[name], random.Random(7)
    stream = rng.randbytes(1_000_000)
    parser = PacketParser(framing)
    found = [p for i in range(0, len(stream), 4096) for p in parser.feed(stream[i : i + 4096])]
    assert all(packet(framing, payload) in stream for payload in found)
    assert parser.waiting < 64
    true = payloads_of(name, 3)
    assert parser.feed(bytes(64) + b"".join(packet(framing, p) for p in true))[-3:] == true


@pytest.mark.parametrize("name", ["footer", "header", "both"])
def test_a_million_random_bytes_do_not_hold_up_a_parser_without_checksum(name):
    parser = PacketParser(FRAMINGS[name])
    stream = random.Random(3).randbytes(1_000_000)
    found = parser.feed(stream)
    assert len(found) < 100
    assert parser.waiting < 64
    true = payloads_of(name, 4)
    after = parser.feed(bytes(64) + b"".join(packet(FRAMINGS[name], p) for p in true))
    assert set(after) >= set(true[1:-1])


@given(st.lists(st.binary(max_size=300), max_size=20))
@settings(max_examples=100, deadline=None)
def test_random_bytes_give_only_packets_whose_checksum_holds(pieces):
    framing = FRAMINGS["checked"]
    parser = PacketParser(framing)
    stream = b"".join(pieces)
    for piece in pieces:
        for payload in parser.feed(piece):
            assert packet(framing, payload) in stream


def test_a_footer_inside_a_payload_is_told_by_what_can_be_true():
    """An array of magnetometers sends floats and a footer, and a float may contain the footer."""
    values = [25.0, 1.5, -2.0, struct.unpack("<f", b"\x00\x0d\x0a\x41")[0]]
    body = struct.pack("<4f", *values)
    assert b"\r\n" in body

    def warm(payload):
        return 1 <= struct.unpack("<4f", payload)[0] <= 100

    stream = (body + b"\r\n") * 6
    framing = Framing(payload=16, footer=b"\r\n", valid=warm)
    for start in range(18):
        found = PacketParser(framing).feed(stream[start:])
        assert len(found) >= 4
        assert set(found) == {body}


def test_a_header_inside_a_payload_does_not_mislead():
    framing = FRAMINGS["header"]
    sent = [bytes(i) + b"\xaa\x55" + bytes(6 - i) for i in range(1, 7)]
    stream = b"".join(packet(framing, payload) for payload in sent)
    for start in range(len(framing.header) + framing.payload):
        found = PacketParser(framing).feed(stream[start:])
        assert set(found) <= set(sent)
        assert len(found) >= 3


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"checksum": "crc9"}, "unknown checksum 'crc9'; did you mean 'crc8'"),
        ({"covers": "all"}, "unknown part that a checksum covers 'all'"),
        ({"header": b""}, "neither header nor footer"),
        ({"payload": 0}, "a payload of 0 bytes"),
        ({"header": b"", "footer": b"\n", "length_at": 0}, "need a header"),
    ],
)
def test_framings_that_cannot_be(given, message):
    with pytest.raises(ConfigError, match=message):
        Framing(**{"payload": 4, "header": b"\xaa", **given})


def test_hexadecimal_text():
    assert hex_bytes("header", "aa 55") == b"\xaa\x55"
    with pytest.raises(ConfigError, match="header='0x5' is not hexadecimal"):
        hex_bytes("header", "0x5")


def test_datagrams_have_one_length():
    parser = Datagrams(3)
    assert parser.feed(b"abc") == [b"abc"]
    assert parser.feed(b"") == parser.feed(b"abcd") == parser.feed(b"ab") == []
    assert (parser.good, parser.bad, parser.lost) == (1, 2, 6)
