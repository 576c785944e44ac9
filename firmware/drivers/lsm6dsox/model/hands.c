/* SPDX-License-Identifier: Apache-2.0 */
#include "hands.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define LINE_MAX_SIZE 256
/* A look at the pipe costs a system call; nobody moves a hand within this. */
#define LOOK_PERIOD_S 0.002

struct hands {
	int fd;
	char line[LINE_MAX_SIZE];
	size_t line_len;
	bool has_target;
	struct chip_motion from;
	struct chip_motion to;
	double begin_s;
	double end_s;
	double looked_s;
};

struct hands *hands_open(const char *path, const struct chip_motion *start, char *problem,
			 size_t problem_size)
{
	struct hands *h = calloc(1, sizeof(*h));

	if (h == NULL) {
		snprintf(problem, problem_size, "no memory");
		return NULL;
	}
	/* For writing, too: so that a writer who closes is not the end of the file. */
	h->fd = open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC);
	if (h->fd < 0) {
		snprintf(problem, problem_size, "%s", strerror(errno));
		free(h);
		return NULL;
	}
	h->from = *start;
	h->to = *start;
	h->looked_s = -INFINITY;
	return h;
}

void hands_close(struct hands *h)
{
	if (h != NULL) {
		close(h->fd);
		free(h);
	}
}

static bool take_line(struct hands *h, double t_s)
{
	struct chip_motion next;
	double duration_s;
	int used = 0;

	if (sscanf(h->line, "%lf,%lf,%lf,%lf,%lf,%lf,%lf%n", &duration_s, &next.accel_mps2[0],
		   &next.accel_mps2[1], &next.accel_mps2[2], &next.gyro_radps[0],
		   &next.gyro_radps[1], &next.gyro_radps[2], &used) != 7 ||
	    h->line[used] != '\0' || !(duration_s >= 0.0 && duration_s < 1e6)) {
		return false;
	}
	h->from = h->to;
	h->to = next;
	h->begin_s = h->has_target && h->end_s > t_s - LOOK_PERIOD_S ? h->end_s : t_s;
	h->end_s = h->begin_s + duration_s;
	h->has_target = true;
	return true;
}

/* Reads up to the end of one line. @return true when there is one. */
static bool read_line(struct hands *h)
{
	while (h->line_len < LINE_MAX_SIZE - 1) {
		char *at = &h->line[h->line_len];

		if (read(h->fd, at, 1) != 1) {
			return false;
		}
		if (*at == '\n') {
			*at = '\0';
			h->line_len = 0;
			return true;
		}
		h->line_len++;
	}
	h->line[h->line_len] = '\0';
	h->line_len = 0;
	return true;
}

static void interpolate(const struct hands *h, double t_s, struct chip_motion *at)
{
	const double span_s = h->end_s - h->begin_s;
	double share = 1.0;

	if (h->has_target && t_s < h->end_s && span_s > 0.0) {
		share = t_s > h->begin_s ? (t_s - h->begin_s) / span_s : 0.0;
	}
	for (int i = 0; i < 3; i++) {
		at->accel_mps2[i] = h->from.accel_mps2[i] +
				    share * (h->to.accel_mps2[i] - h->from.accel_mps2[i]);
		at->gyro_radps[i] = h->from.gyro_radps[i] +
				    share * (h->to.gyro_radps[i] - h->from.gyro_radps[i]);
	}
}

const char *hands_at(struct hands *h, double t_s, struct chip_motion *at)
{
	const bool carried_out = !h->has_target || t_s >= h->end_s;

	if (carried_out && t_s - h->looked_s >= LOOK_PERIOD_S) {
		h->looked_s = t_s;
		/* Short steps may already be over: the next one follows on. */
		while ((!h->has_target || t_s >= h->end_s) && read_line(h)) {
			if (!take_line(h, t_s)) {
				return h->line;
			}
		}
	}
	interpolate(h, t_s, at);
	return NULL;
}
