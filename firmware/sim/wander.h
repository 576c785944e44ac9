/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Frequency wander of a simulated crystal: a sum of sinusoids.
 *
 *   y(t) = sum_k A_k sin(2 pi t / T_k + P_k)            relative frequency error, 1
 *   x(t) = integral of y from 0 to t
 *        = sum_k A_k T_k / (2 pi) (cos(P_k) - cos(2 pi t / T_k + P_k))      time error, s
 *
 * t is true time in seconds. Plain C: no simulator header is needed.
 */
#ifndef BV_SIM_WANDER_H
#define BV_SIM_WANDER_H

#include <stdbool.h>
#include <stddef.h>

#define WANDER_MAX_TERMS 16

/* Largest allowed sum of the amplitudes; keeps time monotone and the inverse quick to find. */
#define WANDER_MAX_AMPLITUDE 1e-3

struct wander {
	size_t count;
	struct {
		double amplitude;  /* A_k, 1 */
		double period_s;   /* T_k, s, > 0 */
		double phase_rad;  /* P_k, rad */
	} term[WANDER_MAX_TERMS];
};

/* Read "A:T:P[,A:T:P...]". Returns NULL, or what is wrong with the text. */
const char *wander_parse(struct wander *w, const char *text);

/* x(t): how far a crystal with this wander alone is ahead at true time t_s, in seconds. */
long double wander_time_error_s(const struct wander *w, long double t_s);

#endif /* BV_SIM_WANDER_H */
