#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Saturation of the writer of a sweep over MPI: an analytical model, and a simulation of its queue with measured costs.

Usage: tools/sweep_queue.py [--ranks N] [--case SECONDS] [--spread S] [--words N] [--record SECONDS] [--message SECONDS]

Rank 0 receives the records of the ranks, writes them, and gives them ranges of cases; the rules are those of
io/src/tandem_io/sweep/schedule.f90 and mpi/src/tandem_mpi/ranks.f90: a range lasts 0.1 s or four delays, each rank has a second
one waiting, and a rank gathers its records for 0.5 ms times the number of ranks. Without arguments, prints the table of
doc/sweep.md. Costs: --record for a record that rank 0 takes, checks and writes, --message for a message, both in seconds.
"""

import argparse
import heapq
import random

SHORTEST, GATHERING, MOST = 0.1, 5e-4, 20000
LATENCY = 5e-6
#: Measured on one machine: processor seconds of rank 0 for a record of 9 words (taken apart, summed, written: 0.12 us in a loop of
#: two millions, and 12 words copied out of the message), and for a message with its answer (OpenMPI 4.1, shared memory, 500 words).
RECORD, MESSAGE = 0.14e-6, 1.3e-6


def on_paper(ranks, case, words, record, message):
    """Messages, records and bytes per second that reach rank 0 from ranks that are always busy, and load of rank 0."""
    delay = GATHERING * ranks
    lasting = max(SHORTEST, 4 * delay)
    # A rank sends when it has gathered long enough, but not more often than it finishes cases.
    told = ranks * min(1 / case, 1 / max(delay, 2e-3))
    given = ranks * min(1 / case, 1 / lasting)
    records = ranks / case
    return told + given, records, 8 * words * records, records * record + (told + given) * message


def simulate(ranks, case, spread, record, message, seconds):
    """Run the queue: each rank works through its ranges, gathers, sends; rank 0 handles one message after the other. Returns the
        share of the ranks' time spent on work, and that of rank 0, after the first half of the time."""
    rng = random.Random(1)
    delay = GATHERING * ranks
    lasting = max(SHORTEST, 4 * delay)
    length = max(1, min(MOST, int(lasting / case)))
    queue = [0] * ranks  # ranges that a rank has
    left = [0] * ranks  # cases of the current one
    idle_since = [0.0] * ranks
    worked, served, free_at = 0.0, 0.0, 0.0
    untold = [0] * ranks
    passed = [0] * ranks  # ranges that are done and not yet reported
    since = [0.0] * ranks
    events = []
    begin = seconds / 2

    def work(rank, now):
        """The next piece of work of a rank: as many cases as fit in what is left to gather, one at least."""
        nonlocal worked
        if left[rank] == 0:
            if queue[rank] == 0:
                idle_since[rank] = now
                return
            left[rank] = length
        cases = min(left[rank], max(1, int(max(delay, 2e-3) / case)))
        time = sum(rng.lognormvariate(0.0, spread) for _ in range(cases)) * case if cases < 8 else cases * case
        if now > begin:
            worked += time
        left[rank] -= cases
        heapq.heappush(events, (now + time, 0, rank, cases))

    for rank in range(ranks):
        queue[rank] = 2
        heapq.heappush(events, (rng.uniform(0, lasting), 2, rank, 0))
    while events:
        now, kind, rank, number = heapq.heappop(events)
        if now > seconds:
            break
        if kind == 0:  # cases are done
            if untold[rank] == 0:
                since[rank] = now
            untold[rank] += number
            if left[rank] == 0:
                queue[rank] -= 1
                passed[rank] += 1
            is_idle = left[rank] == 0 and queue[rank] == 0
            if is_idle or now - since[rank] >= delay or number * case >= delay:
                heapq.heappush(events, (now + LATENCY, 1, rank, (untold[rank], passed[rank])))
                untold[rank], passed[rank] = 0, 0
            work(rank, now)
        elif kind == 1:  # rank 0 gets a message
            records, ranges = number
            time = message * (1 + ranges) + records * record
            free_at = max(now, free_at) + time
            if now > begin:
                served += time
            for _ in range(ranges):
                heapq.heappush(events, (free_at + LATENCY, 2, rank, 1))
        else:  # a rank is given a range
            was_idle = left[rank] == 0 and queue[rank] == 0
            queue[rank] += number
            if was_idle or number == 0:
                work(rank, now)
    span = seconds - begin
    return worked / (ranks * span), served / span


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--ranks", type=int)
    parser.add_argument("--case", type=float, default=0.1)
    parser.add_argument("--spread", type=float, default=0.5)
    parser.add_argument("--words", type=int, default=12)
    parser.add_argument("--record", type=float, default=RECORD)
    parser.add_argument("--message", type=float, default=MESSAGE)
    options = parser.parse_args()
    rows = [(options.ranks, options.case)] if options.ranks else [
        (64, 1e-3), (1000, 1e-3), (10000, 1.0), (10000, 1e-1), (10000, 1e-2), (10000, 2e-3), (10000, 1.4e-3), (10000, 7e-4)]
    print("| ranks | a case | messages a second | records a second | MB a second | rank 0 busy, on paper | simulated | ranks at work |")
    print("|---|---|---|---|---|---|---|---|")
    for ranks, case in rows:
        messages, records, bytes_, busy = on_paper(ranks, case, options.words, options.record, options.message)
        lasting = max(SHORTEST, 4 * GATHERING * ranks)
        at_work, served = simulate(ranks, case, options.spread, options.record, options.message, (16 if busy > 0.9 else 6) * lasting + 8 * case)
        print(f"| {ranks} | {case:g} s | {messages:.0f} | {records:.3g} | {bytes_ / 1e6:.3g} | {100 * busy:.0f} % | "
              f"{100 * served:.0f} % | {100 * at_work:.0f} % |", flush=True)


if __name__ == "__main__":
    main()
