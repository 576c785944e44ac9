# SPDX-License-Identifier: Apache-2.0
"""The lines of the error budget: the only place where a limit is written down in code."""

from __future__ import annotations

from typing import Final

from hil.budget.model import Case, Conditions, Line
from hil.budget.sources import SIM_ALIAS_NS


def _always(_: Conditions) -> bool:
    return True


def _short_interval(c: Conditions) -> bool:
    return c.conn_interval_us <= 10_000


def _sim_2m(c: Conditions) -> bool:
    return c.simulated and c.phy == 2


def _sim_1m(c: Conditions) -> bool:
    return c.simulated and c.phy == 1


def _bench_2m(c: Conditions) -> bool:
    return not c.simulated and c.phy == 2


def _simulated(c: Conditions) -> bool:
    return c.simulated


def _lossy(c: Conditions) -> bool:
    return c.lossy


def _lossy_short(c: Conditions) -> bool:
    return c.lossy and _short_interval(c)


def _by_interval(short: float, long: float, marginal: float) -> tuple[Case, ...]:
    return (
        Case("interval <= 10 ms", _short_interval, high=short, marginal=marginal),
        Case("interval > 10 ms", _always, high=long, marginal=marginal),
    )


def _none(condition: str = "always") -> tuple[Case, ...]:
    return (Case(condition, _always, high=0.0),)


LINES: Final[tuple[Line, ...]] = (
    Line(
        "T1",
        "sync error, 99th percentile",
        "ns",
        "2.58 times the rms of T3: 2.58 * 27.2 = 70 ns at 7.5 ms, 2.58 * 81.8 = 211 ns at 30 ms; "
        "the limits are what the product asks for",
        _by_interval(150.0, 300.0, 10.0),
    ),
    Line(
        "T2",
        "sync error, largest",
        "ns",
        "4.5 times the rms of T3: 4.5 * 27.2 = 122 ns and 4.5 * 81.8 = 368 ns; limits in "
        "proportion to T1's, 5/3 and 3/2 of them",
        _by_interval(250.0, 450.0, 10.0),
    ),
    Line(
        "T3",
        "sync error, rms",
        "ns",
        "grid behind the fit, wander within the window, COMPARE in whole ticks: "
        "sqrt(11.83^2 + 16.50^2 + 18.04^2) = 27.2 ns at 7.5 ms, "
        "sqrt(64.15^2 + 47.40^2 + 18.04^2) = 81.8 ns at 30 ms; limits 2/5 of T1's",
        _by_interval(60.0, 120.0, 5.0),
    ),
    Line(
        "T4",
        "firmware model against an independent fit of the same captures, 99th percentile",
        "ns",
        "both are within T1 of the truth; they share the captures, so their difference may "
        "not exceed one T1",
        _by_interval(150.0, 300.0, 10.0),
    ),
    Line(
        "T5",
        "skew error, 99th percentile",
        "ppb",
        "grid in the slope and its lag behind the wander: "
        "2.58 * sqrt(10.0^2 + 41.4^2) = 110 ppb at 7.5 ms, "
        "2.58 * sqrt(52.5^2 + 110.2^2) = 315 ppb at 30 ms; over the 0.1 s that a model is "
        "extrapolated the limits amount to 20 and 40 ns",
        _by_interval(200.0, 400.0, 10.0),
    ),
    Line(
        "T6",
        "time from the first connection event to a locked model",
        "s",
        "one full window W = 2 s, one more to replace the pairs taken while the link's "
        "parameters change, 1 s for the exchange of features and lengths",
        (Case("always", _always, high=5.0),),
    ),
    Line(
        "T7",
        "share of the time after lock in which the model is locked, less the holds asked for",
        "1",
        "a loss-free link never leaves lock; a window of 2 s outlives any loss shorter than "
        "itself; the lock after a hold is T6's",
        (Case("always", _always, low=0.99),),
    ),
    Line(
        "T8",
        "longest use of one model",
        "s",
        "a model is extrapolated with its skew error, rms of T5: in 1 s, "
        "1 * sqrt(52.5^2 + 110.2^2) = 122 ns at 30 ms, still below T1",
        (Case("always", _always, high=1.0),),
    ),
    Line(
        "G1",
        "difference of the pulse edges on the analyser, 99th percentile and largest",
        "ns",
        "simulation: two edges floored to the grid of 1 us, and T2 at 30 ms: "
        "1000 + 450 = 1450 ns; an analyser as coarse as the grid is included. "
        "Bench: T2 at 30 ms and an allowance for RX END jitter, which is not known on silicon: "
        "450 + 550 = 1000 ns; the analyser's resolution is not included, it widens the "
        "uncertainty",
        (
            Case("simulated", _simulated, high=1500.0),
            Case("bench", _always, high=1000.0),
        ),
    ),
    Line(
        "G2",
        "pulse edge against its programmed COMPARE",
        "ns",
        "the simulator floors COMPARE to its grid of 1000 ns; bench time is in whole ns",
        (Case("always", _always, high=1001.0),),
    ),
    Line(
        "B1",
        "one-way bias: leader to follower minus half the round trip",
        "ns",
        "chain delay of transmitter and receiver: 5000 ns on 2M and 9000 ns on 1M in "
        "simulation, within half the grid; on silicon about 5600 and 10000 ns from Zephyr's "
        "radio header, not measured, so within 1000 ns",
        (
            Case("simulated, 2M", _sim_2m, low=4500.0, high=5500.0),
            Case("simulated, 1M", _sim_1m, low=8500.0, high=9500.0),
            Case("bench, 2M", _bench_2m, low=4600.0, high=6600.0),
            Case("bench, 1M", _always, low=9000.0, high=11000.0),
        ),
    ),
    Line(
        "B2",
        "mean error of the pairs' offset",
        "ns",
        "chain delays cancel in the two-way offset; what is left is the aliasing of the "
        "drifts with the simulator's grid, at most 200 ns",
        (Case("always", _always, low=-SIM_ALIAS_NS, high=SIM_ALIAS_NS),),
    ),
    Line(
        "P1",
        "wrong pairs: captures of another event, or offset off by more than 2 us",
        "1",
        "two roundings of at most half the grid: 2 * 1000 / 2 = 1000 ns, and as much again for "
        "silicon; the END of another packet is at least 150 us + 44 us away, which moves the "
        "offset by (150 + 44) / 2 = 97 us",
        _none(),
    ),
    Line(
        "P2",
        "pairs used, as a share of connection events",
        "1",
        "seven tenths of the pairs widen T1 to 211 * sqrt(1/0.7) = 252 ns at 30 ms, within its "
        "limit; a channel that corrupts 8 % of packets leaves 100 * 0.92 * 0.92 = 85 % of events "
        "whole",
        (
            Case("lossy channel", _lossy, low=0.7),
            Case("always", _always, low=0.95),
        ),
    ),
    Line(
        "P3",
        "pairs dropped as outliers, as a share of all pairs",
        "1",
        "a gate at four sigma drops 1 in 16,000; the rest allows for the first window, whose "
        "sigma is not yet known",
        (Case("always", _always, high=0.02),),
    ),
    Line(
        "P4",
        "captures without an END edge on the analyser",
        "1",
        "the edge and the capture come from the same PPI event",
        _none(),
    ),
    Line(
        "P5",
        "pulses missing or without an edge, late pulses",
        "1",
        "while locked, both nodes emit every pulse, from the newest model that has arrived, "
        "which T8 lets be 1 s old",
        _none(),
    ),
    Line(
        "W1",
        "breaks in the 64-bit ticks",
        "1",
        "the 32-bit counter wraps every 2^32 / 16e6 = 268.4 s; each wrap is extended, so "
        "time stamps never step back nor jump by 2^32",
        _none(),
    ),
    Line(
        "L1",
        "reconnects, restarts and faults that the run did not ask for",
        "1",
        "the supervision timeout outlives any loss of the channels in the scenarios",
        _none(),
    ),
    Line(
        "L2",
        "serial frames lost, corrupted, malformed or repeated; bytes of noise",
        "1",
        "1 Mbaud carries the stream; the reader is lossless",
        _none(),
    ),
    Line(
        "L3",
        "radio packets with a wrong CRC per connection event",
        "1",
        "an ideal channel corrupts none. An event carries about four packets; an eighth of them "
        "corrupted is 4 * 0.125 = 0.5, which leaves 0.875 * 0.875 = 0.77 of the events for P2. "
        "A lossy channel with hardly an error would test nothing",
        (
            Case("lossy channel", _lossy, low=0.01, high=0.5),
            Case("simulated", _simulated, high=0.0),
            Case("bench", _always, high=0.1),
        ),
    ),
    Line(
        "L4",
        "messages dropped in the nodes' queues, refused payloads",
        "1",
        "queues hold more than one window of retransmission",
        _none(),
    ),
    Line(
        "L5",
        "HELLO frames that do not name the expected image",
        "1",
        "role, target, schema hash, tick rate and build id must equal the manifest's",
        _none(),
    ),
    Line(
        "L6",
        "longest time without a HELLO",
        "s",
        "HELLO is sent every 2 s; 1 s for a line that is full for a moment",
        (Case("always", _always, high=3.0),),
    ),
    Line(
        "L8",
        "range of the time that a node's frames take to the host's clock",
        "s",
        "up to 8192 bytes wait for a line of 1 Mbaud, ten bits each: 8192 * 10 / 1e6 = 0.082 s; "
        "0.068 s for the USB and the host: 0.082 + 0.068 = 0.15 s",
        (Case("always", _always, high=0.15),),
    ),
    Line(
        "L7",
        "delivery to the leader interrupted by a disconnection asked for, less the hold asked for",
        "s",
        "0.15 s until an advertisement is heard, 0.3 s on its way when the link ends, and some 60 "
        "connection events to raise PHY, length and MTU, to discover, to subscribe and to "
        "confirm the clock model: 0.45 + 60 * 0.0075 = 0.9 s, 0.45 + 60 * 0.03 = 2.25 s",
        _by_interval(1.0, 2.5, 0.0),
    ),
    Line(
        "L9",
        "delivery to the leader interrupted for longer than the hold asked for",
        "s",
        "a node that stays away hears nothing; what was on its way before, up to 0.3 s, comes "
        "sooner than the set-up after it, which takes some 60 connection events, lets through: "
        "60 * 0.0075 = 0.45 s, 0.45 - 0.3 = 0.15 s at least",
        (Case("always", _always, low=0.0),),
    ),
    Line(
        "I1",
        "IMU samples lost, repeated, out of order or altered",
        "1",
        "the FIFO is read before it fills, and the link layer delivers each batch once",
        _none(),
    ),
    Line(
        "I2",
        "sample rate over the nearest nominal rate",
        "1",
        "the chip's oscillator is several percent off; logs of real chips run at -6.8 %",
        (Case("always", _always, low=0.9, high=1.1),),
    ),
    Line(
        "I3",
        "period in the batches against the slope of their time stamps",
        "ppm",
        "the period is in 1/256 tick of 2400 ticks at 6.67 kHz: 1e6 / 256 / 2 / 2400 = 0.8 ppm; "
        "two stamps on the grid of 1 us, 1 s apart, add 1.4 ppm; 20 ppm is what the driver must "
        "reach",
        (Case("always", _always, high=20.0),),
    ),
    Line(
        "I4",
        "time of a batch against the one before plus its samples' periods",
        "us",
        "two stamps on the grid of 1 us, each off by it at most: 2 * 1 = 2 us",
        (Case("always", _always, high=2.0),),
    ),
    Line(
        "I5",
        "follower's batch time on the leader's clock against truth, 99th percentile",
        "ns",
        "T1 and half a tick for the conversion to whole ticks: 150 + 31.25 = 181 ns, "
        "300 + 31.25 = 331 ns",
        _by_interval(182.0, 332.0, 10.0),
    ),
    Line(
        "I6",
        "age of the last sample of a follower's batch at the leader's serial line, 99th percentile",
        "ms",
        "20 ms for both nodes' threads and 216 B at 1 Mbaud, one interval to the next event and "
        "two for batches queued before: 20 + 3 * 7.5 = 42.5 ms, 20 + 3 * 30 = 110 ms; where a "
        "lossy channel repeats packets, eight intervals: 20 + 8 * 7.5 = 80 ms, "
        "20 + 8 * 30 = 260 ms",
        (
            Case("lossy channel, interval <= 10 ms", _lossy_short, high=80.0),
            Case("lossy channel, interval > 10 ms", _lossy, high=260.0),
            Case("interval <= 10 ms", _short_interval, high=45.0),
            Case("interval > 10 ms", _always, high=110.0),
        ),
    ),
    Line(
        "I7",
        "batch time against the instant at which the chip took the sample, largest",
        "us",
        "an edge falls on the nearest whole microsecond of the node's clock: 1000 / 2 = 500 ns; a "
        "batch counts as timed by hardware while the driver's own sigma is below six ticks: "
        "6 * 62.5 = 375 ns; together 500 + 375 = 875 ns",
        (Case("always", _always, high=1.0),),
    ),
    Line(
        "I8",
        "period in the batches against the chip's true one on the node's clock, largest",
        "ppm",
        "resolution of the period at 6.67 kHz, 0.8 ppm as in I3; after 2 s of edges that are off "
        "by 0.29 us rms each, the driver's filter leaves some 3 ppm; 20 ppm is what it must reach",
        (Case("always", _always, high=20.0),),
    ),
    Line(
        "I9",
        "rising edge of INT1 against the nearest sample instant of the batches, 99th percentile",
        "us",
        "simulation: the batch's time as in I7, and half the grid of 1 us for the edge: "
        "1 + 0.5 = 1.5 us. Bench: I7; the analyser's resolution is not included, it widens the "
        "uncertainty",
        (
            Case("simulated", _simulated, high=1.5),
            Case("bench", _always, high=1.0),
        ),
    ),
    Line(
        "F1",
        "overruns, tag gaps, parity errors, changes of configuration, short reads, bus errors, "
        "edges missed or refused, restarts of the IMU",
        "1",
        "a sound chip on a sound bus gives the driver nothing to count",
        _none(),
    ),
    Line(
        "F2",
        "largest FIFO level, as a share of its 512 words",
        "1",
        "at 6.67 kHz, two words a sample, half of the FIFO lasts 512 / 2 / (2 * 6667) = 0.0192 s: "
        "what is left for a thread that is held up once more",
        (Case("always", _always, high=0.5),),
    ),
    Line(
        "F3",
        "share of time in which the SPI bus is busy",
        "1",
        "at 6.67 kHz and 8 MHz: 6667 * 2 * 7 * 8 / 8000000 = 0.0933; 10 % for a fast chip and 10 % "
        "for addresses and status: 0.0933 * 1.1 * 1.1 = 0.113",
        (Case("always", _always, high=0.15),),
    ),
    Line(
        "F4",
        "share of time in which the processor is not idle, mean",
        "1",
        "half is left for radio bursts and the estimator's longest step; simulated processors "
        "take no time but in busy waits, so there the figure has no limit",
        (
            Case("simulated", _simulated),
            Case("bench", _always, high=0.5),
        ),
    ),
    Line(
        "F5",
        "from the edge that ends a rest to the first sample",
        "ms",
        "80 ms for the gyroscope to turn on, three watermarks of 40 ms on a chip that is 10 % "
        "slow, 10 ms of set-up: 80 + 3 * 40 * 1.1 + 10 = 222 ms",
        (Case("always", _always, high=250.0),),
    ),
    Line(
        "F6",
        "signs of a fault that the scenario injects, under its own name",
        "1",
        "each counter and each FAULT frame that belongs to the fault's kind, once at least",
        (Case("always", _always, low=1.0),),
    ),
    Line(
        "F7",
        "from the end of an injected fault to batches with hardware times",
        "s",
        "a chip that is asked every 0.1 s at worst, set up and settled as in F5, and a margin of "
        "three: 3 * (0.1 + 0.222) = 0.97 s",
        (Case("always", _always, high=1.0),),
    ),
    Line(
        "C1",
        "from a node's first sample at rest to its first corrected one",
        "s",
        "a still window of 1 s; another that had begun in motion; 0.1 s until the batch is read "
        "and 0.25 s until the sensor has settled: 2.35 s",
        (Case("always", _always, high=2.5),),
    ),
    Line(
        "C2",
        "decisions of the boot check that are wrong, not said, or not waited for",
        "1",
        "0.3 and 2 dps are the limits of the branches; each is decided in one comparison",
        _none(),
    ),
    Line(
        "C3",
        "gyroscope bias in force against the chip's own, worst axis",
        "dps",
        "noise of 3.8 mdps/rtHz averaged over 1 s: 2.7 mdps; rounding of 70 mdps counts that the "
        "noise smooths: 1 mdps; six sigma of both is 0.0173 dps",
        (Case("always", _always, high=0.02),),
    ),
    Line(
        "C4",
        "distance of boot bias and stored bias, reported against true",
        "dps",
        "C3 on each of three axes: 0.02 * 1.732 = 0.0346 dps",
        (Case("always", _always, high=0.035),),
    ),
    Line(
        "K1",
        "EKF frames of which any bit is not the host core's",
        "1",
        "the same sources, built with the same contraction, on the same samples",
        _none(),
    ),
    Line(
        "K2",
        "EKF frames over samples of the leader's IMU",
        "1",
        "about 104 frames a second whatever the rate: at 1667 Hz one in 16, at 104 Hz and below "
        "every one, less what the alignment takes: 1 / 16 = 0.0625",
        (Case("always", _always, low=0.05, high=1.0),),
    ),
    Line(
        "K3",
        "estimator in double against the NumPy reference, relative to each state's scale",
        "1",
        "a double's rounding, 2.2e-16, over 25000 steps of states of one size, all one way, is "
        "5.5e-12; two orders more for the condition of the covariance",
        (Case("always", _always, high=1e-9),),
    ),
    Line(
        "K4",
        "estimator in float against the reference: velocity",
        "m/s",
        "a float's rounding, 6e-8 of 10 m/s^2, over 60 s, all one way, is 3.6e-5 m/s; that of the "
        "covariance moves the gains by more",
        (Case("always", _always, high=1e-3),),
    ),
    Line(
        "K5",
        "estimator in float against the reference: attitude",
        "deg",
        "6e-8 rad a step, 25000 steps, all one way, is 0.0015 rad or 0.086 deg; they do not go one "
        "way",
        (Case("always", _always, high=0.05),),
    ),
    Line(
        "M1",
        "mean velocity of a repetition, sets with rests, RMSE over the set",
        "mm/s",
        "a third of the 37.6 mm/s of the best public figure without a camera",
        (Case("always", _always, high=10.0),),
    ),
    Line(
        "M2",
        "peak velocity of a repetition, sets with rests, RMSE over the set",
        "mm/s",
        "a third of the 47.9 mm/s of the best public figure without a camera",
        (Case("always", _always, high=15.0),),
    ),
    Line(
        "K6",
        "repetitions missed or invented; zero-velocity updates on a bar that moves",
        "1",
        "either makes every figure after it wrong",
        _none(),
    ),
    Line(
        "K7",
        "inclination, RMSE over the set",
        "deg",
        "a calibrated accelerometer's 10 mm/s^2 of bias tilt the level by 0.010 / 9.81 = 0.00102 "
        "rad, 0.058 deg on each of two axes; ten times that for a whole set of motion",
        (Case("always", _always, high=0.6),),
    ),
    Line(
        "K8",
        "repetitions of the firmware's REP frames that are not those of hil.reps, or missing",
        "1",
        "the same definition on the same EKF frames; each differs by its time, kind, phases, start "
        "or by which figures it has",
        _none(),
    ),
    Line(
        "K9",
        "mean or peak velocity in a REP frame against hil.reps of the EKF frames, largest",
        "mm/s",
        "a float's rounding of a travel of 1 m, 0.06 um, in each of 300 additions, all one way, "
        "over 0.5 s: 0.06 * 300 / 0.5 = 36 um/s",
        (Case("always", _always, high=0.05),),
    ),
    Line(
        "M3",
        "mean velocity of a repetition, touch and go, RMSE over the set",
        "mm/s",
        "twice what is asked where the bar rests: height is known to a turn's spread only",
        (Case("always", _always, high=20.0),),
    ),
    Line(
        "M4",
        "peak velocity of a repetition, touch and go, RMSE over the set",
        "mm/s",
        "twice what is asked where the bar rests",
        (Case("always", _always, high=30.0),),
    ),
    Line(
        "E1",
        "steps whose outputs on the processor differ from the host core's in any bit",
        "1",
        "both use IEEE 754 single precision, the same order of operations and no contraction",
        (Case("always", _always, high=0.0),),
    ),
    Line(
        "E2",
        "longest step with a rigid-body update and no other",
        "instructions",
        "what the product asks for; at 3 cycles each, 12000 * 3 = 36000 of the "
        "64e6 / 416 = 153846 cycles between two samples",
        (Case("always", _always, high=12_000.0),),
    ),
    Line(
        "E3",
        "longest step of any kind, cache off and no fetch overlapped",
        "cycles",
        "a step must end before the next sample: 64e6 / 416 = 153846; one third is left for the "
        "radio and the drivers: 153846 * 2 / 3 = 102564",
        (Case("always", _always, high=102_564.0),),
    ),
    Line(
        "E4",
        "share of the processor at 416 Hz, cache off",
        "1",
        "a fifth of 64 MHz, so that half is left in line F4 with radio and drivers: "
        "0.2 * 64e6 / 416 = 30769 cycles a step on average",
        (Case("always", _always, high=0.2),),
    ),
    Line(
        "E5",
        "bytes of stack below a step's caller, bound over all inputs",
        "B",
        "a third of the fusion thread's 6144 B: 6144 / 3 = 2048; the rest is the caller's, and "
        "interrupts' frames of 104 B",
        (Case("always", _always, high=2048.0),),
    ),
    Line(
        "E6",
        "functions of the heap in the linked program",
        "1",
        "the estimator has fixed sizes",
        (Case("always", _always, high=0.0),),
    ),
    Line(
        "D1",
        "change of the sync error over a long run, rms or mean, as a share of its rms, where its "
        "95 % confidence interval excludes zero",
        "1",
        "T3 leaves 60 - 27.2 = 32.8 ns at 7.5 ms; a tenth of 27.2 ns a run would use it up in "
        "32.8 / 2.72 = 12.06 runs",
        (Case("always", _always, high=0.1),),
    ),
    Line(
        "D2",
        "stack left that a node loses, or heap in use that it gains, over a long run, where the "
        "interval excludes zero",
        "B",
        "a chunk of Zephyr's heap is 8 B at least; one lost every 1.5 h of six hours: "
        "8 * 6 / 1.5 = 32 B",
        (Case("always", _always, high=32.0),),
    ),
    Line(
        "D3",
        "memory that the rig gains for each chunk that it writes in a long run, where the interval "
        "excludes zero",
        "KiB",
        "a recording's index, written at its end, has an entry of at most 1.1 KiB for each chunk, "
        "of which one is closed each second; a third more for the allocator: 1.1 * 4 / 3 = 1.47; "
        "from 300 s on, when the recorder's buffers have their size",
        (Case("always", _always, high=1.47),),
    ),
    Line(
        "R1",
        "blocks missing from the recording, or a recording that was cut",
        "1",
        "what is not there cannot be judged",
        _none(),
    ),
)
