/* SPDX-License-Identifier: Apache-2.0 */
#include "wander.h"

#include <math.h>
#include <stdlib.h>

static const long double two_pi = 6.283185307179586476925286766559L;

static bool read_number(const char **cursor, char terminator, double *value)
{
	char *end;

	*value = strtod(*cursor, &end);
	if (end == *cursor || !isfinite(*value)) {
		return false;
	}
	if (terminator != '\0') {
		if (*end != terminator) {
			return false;
		}
		end++;
	}
	*cursor = end;
	return true;
}

const char *wander_parse(struct wander *w, const char *text)
{
	double sum = 0.0;

	w->count = 0;
	while (true) {
		if (w->count == WANDER_MAX_TERMS) {
			return "too many terms";
		}
		double *amplitude = &w->term[w->count].amplitude;
		double *period_s = &w->term[w->count].period_s;
		double *phase_rad = &w->term[w->count].phase_rad;

		if (!read_number(&text, ':', amplitude) || !read_number(&text, ':', period_s) ||
		    !read_number(&text, '\0', phase_rad)) {
			return "each term must read amplitude:period_s:phase_rad";
		}
		if (*period_s <= 0.0) {
			return "a period must be positive";
		}
		sum += fabs(*amplitude);
		if (sum > WANDER_MAX_AMPLITUDE) {
			return "the amplitudes add up to more than 1e-3";
		}
		w->count++;
		if (*text == '\0') {
			return NULL;
		}
		if (*text++ != ',') {
			return "terms must be separated by commas";
		}
	}
}

long double wander_time_error_s(const struct wander *w, long double t_s)
{
	long double sum_s = 0.0L;

	for (size_t k = 0; k < w->count; k++) {
		const long double period_s = w->term[k].period_s;
		const long double phase_rad = w->term[k].phase_rad;

		sum_s += w->term[k].amplitude * period_s / two_pi *
			 (cosl(phase_rad) - cosl(two_pi * t_s / period_s + phase_rad));
	}
	return sum_s;
}
