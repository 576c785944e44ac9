/* SPDX-License-Identifier: Apache-2.0 */
#include "fault.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const names[FAULT_KINDS] = {
	[FAULT_STUCK_BUS] = "stuck_bus",       [FAULT_WRONG_WHO_AM_I] = "wrong_who_am_i",
	[FAULT_DROPPED_EDGE] = "dropped_edge", [FAULT_OVERRUN] = "overrun",
	[FAULT_BIT_ERRORS] = "bit_errors",     [FAULT_MISSING_INT] = "missing_int",
};

static char problem[160];

static const char *parse_one(struct fault *fault, const char *text, size_t length)
{
	double *const numbers[] = {&fault->start_s, &fault->duration_s, &fault->rate};
	const size_t name_length = strcspn(text, ":,");
	const char *at = text + name_length;
	size_t kind = 0;

	while (kind < FAULT_KINDS && (strlen(names[kind]) != name_length ||
				      strncmp(names[kind], text, name_length) != 0)) {
		kind++;
	}
	if (kind == FAULT_KINDS) {
		snprintf(problem, sizeof(problem),
			 "unknown fault '%.*s'; known: stuck_bus wrong_who_am_i dropped_edge "
			 "overrun bit_errors missing_int",
			 (int)name_length, text);
		return problem;
	}
	fault->kind = (enum fault_kind)kind;
	fault->start_s = 0.0;
	fault->duration_s = 0.0;
	fault->rate = NAN;
	for (size_t i = 0; i < 3 && at < text + length; i++) {
		char *end;

		*numbers[i] = strtod(at + 1, &end);
		if (end == at + 1 || (*end != ':' && end != text + length) ||
		    !(*numbers[i] >= 0.0)) {
			snprintf(problem, sizeof(problem),
				 "'%.*s': START, DURATION and RATE are numbers that are not "
				 "negative",
				 (int)length, text);
			return problem;
		}
		at = end;
	}
	if (at != text + length) {
		snprintf(problem, sizeof(problem),
			 "'%.*s': at most KIND:START:DURATION:RATE", (int)length, text);
		return problem;
	}
	if (fault->duration_s == 0.0) {
		fault->duration_s = INFINITY;
	}
	return NULL;
}

const char *faults_parse(struct faults *faults, const char *text)
{
	for (;;) {
		const size_t length = strcspn(text, ",");
		const char *wrong;

		if (faults->count == FAULTS_MAX) {
			return "too many faults";
		}
		wrong = parse_one(&faults->fault[faults->count], text, length);
		if (wrong != NULL) {
			return wrong;
		}
		faults->count++;
		if (text[length] == '\0') {
			return NULL;
		}
		text += length + 1;
	}
}

const struct fault *faults_active(const struct faults *faults, enum fault_kind kind, double t_s)
{
	for (size_t i = 0; i < faults->count; i++) {
		const struct fault *f = &faults->fault[i];

		if (f->kind == kind && t_s >= f->start_s && t_s < f->start_s + f->duration_s) {
			return f;
		}
	}
	return NULL;
}

double fault_rate(const struct fault *fault, double otherwise)
{
	return isnan(fault->rate) ? otherwise : fault->rate;
}
