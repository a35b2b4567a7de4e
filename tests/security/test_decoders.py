"""Whatever reads bytes from elsewhere, under changed inputs: each is taken or refused, and nothing else happens.

`make test` tries some thousands, the same ones every time; `make fuzz` a million, from a seed that it prints.
"""

import importlib
import os
import pkgutil
import random
import resource

import pytest
from decoders import INSIDE, MESSAGES, Decoder, decoders, mutated

import bpn_shared.messages
from bpn_shared.messages.base import Message

DECODERS = decoders()
INPUTS = int(os.environ.get("BPN_FUZZ_INPUTS", "7000"))
SEED = int(os.environ.get("BPN_FUZZ_SEED", "0"))
MEMORY_KIB = 256 * 1024


@pytest.mark.parametrize("decoder", DECODERS, ids=lambda decoder: decoder.name)
def test_right_inputs_are_taken(decoder: Decoder) -> None:
    for data in decoder.seeds:
        assert repr(decoder.decode(decoder.mend(data))) == repr(decoder.decode(data))


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_a_message_arrives_as_it_was_sent(message: Message) -> None:
    assert type(message).decode(message.encode()) == message


@pytest.mark.timeout(3600 if INPUTS > 100_000 else 300)
@pytest.mark.parametrize("decoder", DECODERS, ids=lambda decoder: decoder.name)
def test_changed_inputs_are_taken_or_refused(decoder: Decoder) -> None:
    rng = random.Random(f"{SEED} {decoder.name}")
    peak_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refused = 0
    count = INPUTS // len(DECODERS) + 1
    for number in range(count):
        data = mutated(rng, decoder.seeds)
        if rng.random() < 0.7:
            data = decoder.mend(data)
        try:
            decoder.decode(data)
        except decoder.refusals:
            refused += 1
        except BaseException as error:  # whatever it is, this input did it
            error.add_note(f"input {number} of seed {SEED} for {decoder.name}: {data[:2000]!r}")
            raise
    assert refused > 0 or not decoder.refusals
    grown_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak_kib
    assert grown_kib < MEMORY_KIB, f"{grown_kib} KiB more than before"


def test_every_kind_of_message_is_tried() -> None:
    for module in pkgutil.iter_modules(bpn_shared.messages.__path__):
        importlib.import_module(f"bpn_shared.messages.{module.name}")
    tried = {type(message) for message in MESSAGES} | INSIDE
    public = {kind for kind in Message.__subclasses__() if not kind.__name__.endswith("Parts")}
    assert public == tried
