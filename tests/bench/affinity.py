#!/usr/bin/env python3
"""Simulation of the job queue: what workers gain by preferring jobs of sessions that they have in memory.

    affinity.py [--workers 16 20 24 34] [--patients 200] [--remembered 6] [--burst MINUTES]

The times of the jobs are those in deploy/CAPACITY.md. Patients arrive as a Poisson process. Each needs a field job, then ten
times a mesh job followed by a solve, with a pause between. A worker remembers the fields and the last mesh of the last
sessions that it computed for and computes again what it lacks. There are three rules:

- `none`: any worker takes the job that has waited longest;
- `head start`: a job is reserved for one second for the worker that ran the last job of its session;
- `own first`: as `head start`, and a worker takes jobs of its own sessions before older ones, unless one has waited for a minute.

A burst triples the patients for MINUTES after the second hour. Prints CSV; seconds are from the request to the end of a job.
"""
import argparse
import heapq
import random
from collections import OrderedDict, deque

SECONDS = {"field": 6.7, "mesh": 6.3, "solve": 10.8}
PLANS, PAUSE_S = 10, 150.0
HEAD_START_S, PATIENCE_S = 1.0, 60.0
HOUR = 3600.0
FIRST_COUNTED, END = HOUR, 12 * HOUR


class Queue:
    def __init__(self, rule, workers, patients_per_hour, remembered, burst_s, seed=1):
        self.rule, self.remembered = rule, remembered
        self.random = random.Random(seed)
        self.events, self.count = [], 0
        self.waiting, self.idle = deque(), set(range(workers))
        self.home, self.plan = {}, {}
        self.memory = [OrderedDict() for _ in range(workers)]  # session: plan of its mesh
        self.busy, self.warm, self.times = 0.0, {"mesh": [], "solve": []}, {"mesh": [], "solve": []}
        t, session = 0.0, 0
        while t < END:
            self.at(t, self.ask, session, "field")
            session += 1
            in_burst = 2 * HOUR <= t < 2 * HOUR + burst_s
            t += self.random.expovariate(patients_per_hour * (3 if in_burst else 1) / HOUR)

    def at(self, t, what, *arguments):
        self.count += 1
        heapq.heappush(self.events, (t, self.count, what, arguments))

    def run(self):
        while self.events and self.events[0][0] < END:
            t, _, what, arguments = heapq.heappop(self.events)
            what(t, *arguments)
            self.hand_out(t)
        return self

    def ask(self, t, session, kind):
        if kind != "solve":
            self.plan[session] = self.plan.get(session, 0) + (kind == "mesh")
        self.waiting.append((session, kind, t))
        self.at(t + HEAD_START_S, lambda t: None)

    def choice(self, worker, t):
        """The job that an idle worker takes, if any."""
        rank = lambda job: self.rank(worker, job, t)
        best = min(self.waiting, key=lambda job: (rank(job), job[2]), default=None)
        return best if best and rank(best) < 2 else None

    def rank(self, worker, job, t):
        session, _, since = job
        if self.rule == "none" or self.home.get(session, worker) == worker:
            return 0
        if t - since < HEAD_START_S - 1e-9:
            return 2
        return 0 if self.rule == "head start" or t - since > PATIENCE_S else 1

    def hand_out(self, t):
        # The idle workers choose in random order.
        for worker in self.random.sample(sorted(self.idle), len(self.idle)):
            job = self.choice(worker, t)
            if job:
                self.waiting.remove(job)
                self.begin(t, worker, *job)

    def begin(self, t, worker, session, kind, since):
        known = self.memory[worker]
        has_field = session in known
        has_mesh = has_field and known[session] == self.plan[session]
        took = SECONDS[kind] * self.random.uniform(0.5, 1.5)
        took += SECONDS["field"] * (kind != "field" and not has_field) + SECONDS["mesh"] * (kind == "solve" and not has_mesh)
        if t > FIRST_COUNTED:
            self.busy += took
            if kind != "field":
                self.warm[kind].append(has_field if kind == "mesh" else has_mesh)
                self.times[kind].append(t + took - since)
        known[session] = self.plan[session]
        known.move_to_end(session)
        while len(known) > self.remembered:
            known.popitem(last=False)
        self.home[session] = worker
        self.idle.discard(worker)
        self.at(t + took, self.end, worker, session, kind)

    def end(self, t, worker, session, kind):
        self.idle.add(worker)
        if kind == "mesh":
            self.ask(t, session, "solve")
        elif self.plan[session] < PLANS:
            self.at(t + self.random.expovariate(1 / PAUSE_S), self.ask, session, "mesh")


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--workers", type=int, nargs="+", default=[16, 18, 20, 24, 34])
    arguments.add_argument("--patients", type=float, default=200, help="patients per hour")
    arguments.add_argument("--remembered", type=int, default=6, help="sessions in a worker's memory")
    arguments.add_argument("--burst", type=float, default=0, help="duration of the burst, minutes")
    asked = arguments.parse_args()
    mean = lambda values: sum(values) / max(len(values), 1)
    print("workers,rule,busy,warm_meshes,warm_solves,mesh_s,solve_s,solve_95_s")
    for workers in asked.workers:
        for rule in ["none", "head start", "own first"]:
            q = Queue(rule, workers, asked.patients, asked.remembered, asked.burst * 60).run()
            busy = q.busy / (workers * (END - FIRST_COUNTED))
            solves = sorted(q.times["solve"])
            shares = f"{busy:.2f},{mean(q.warm['mesh']):.2f},{mean(q.warm['solve']):.2f}"
            times = [mean(q.times["mesh"]), mean(solves), solves[len(solves) * 95 // 100]]
            print(f"{workers},{rule},{shares}," + ",".join(f"{t:.1f}" for t in times))


if __name__ == "__main__":
    main()
