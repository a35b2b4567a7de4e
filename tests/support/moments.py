"""Moments that nobody chose, which can be had again."""

import os
import random
import secrets


def random_moments() -> random.Random:
    """Other ones each time, unless BPN_TEST_SEED says which; a test that fails shows it."""
    seed = os.environ.get("BPN_TEST_SEED") or secrets.token_hex(4)
    print(f"the same moments: BPN_TEST_SEED={seed}")
    return random.Random(seed)
