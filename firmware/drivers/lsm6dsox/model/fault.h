/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Faults that the chip model can be told to have. Plain C11.
 *
 * One fault is KIND[:START[:DURATION[:RATE]]], several are separated by commas. START and DURATION
 * are true time in seconds; without START the fault is there from the beginning, without DURATION
 * (or with 0) it stays. RATE depends on the kind:
 *
 *   stuck_bus        level of every bit read, 0 or 1 (default 1); writes do not reach the chip
 *   wrong_who_am_i   value of WHO_AM_I (default 106, 6Ah)
 *   dropped_edge     probability that an assertion of INT1 does not reach the pin (default 1)
 *   overrun          stalls per second (default: one, at START): the host gets no transfer done
 *                    for as long as it takes the FIFO to overrun by 64 words
 *   bit_errors       probability of each bit read to be wrong (default 1e-5)
 *   missing_int      INT1 stays inactive; RATE is not used
 */
#ifndef BV_LSM6DSOX_FAULT_H_
#define BV_LSM6DSOX_FAULT_H_

#include <stdbool.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

enum fault_kind {
	FAULT_STUCK_BUS,
	FAULT_WRONG_WHO_AM_I,
	FAULT_DROPPED_EDGE,
	FAULT_OVERRUN,
	FAULT_BIT_ERRORS,
	FAULT_MISSING_INT,
	FAULT_KINDS,
};

#define FAULTS_MAX 16

struct fault {
	enum fault_kind kind;
	double start_s;
	/** INFINITY for a fault that stays. */
	double duration_s;
	/** NAN when not given. */
	double rate;
};

struct faults {
	size_t count;
	struct fault fault[FAULTS_MAX];
};

/** Add the faults in @p text. @return NULL, or what is wrong with it (static storage). */
const char *faults_parse(struct faults *faults, const char *text);

/** @return the fault of that kind that is there at @p t_s, or NULL. */
const struct fault *faults_active(const struct faults *faults, enum fault_kind kind, double t_s);

/** @return the fault's rate, or @p otherwise when none was given. */
double fault_rate(const struct fault *fault, double otherwise);

#ifdef __cplusplus
}
#endif

#endif /* BV_LSM6DSOX_FAULT_H_ */
