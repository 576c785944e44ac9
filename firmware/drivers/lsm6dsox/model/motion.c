/* SPDX-License-Identifier: Apache-2.0 */
#include "motion.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAGIC         "BVMOTION"
#define MAGIC_SIZE    8
#define HEADER_SIZE   16
#define VERSION       1
#define TEXT_HEADER   "t_s,ax_mps2,ay_mps2,az_mps2,gx_radps,gy_radps,gz_radps"
#define LINE_MAX_SIZE 512

struct growing {
	struct motion *motion;
	size_t capacity;
};

static bool append(struct growing *g, const double row[MOTION_COLUMNS], char *problem, size_t size)
{
	struct motion *m = g->motion;

	for (int column = 0; column < MOTION_COLUMNS; column++) {
		if (!isfinite(row[column])) {
			snprintf(problem, size, "row %zu, column %d is not a finite number",
				 m->rows + 1, column + 1);
			return false;
		}
	}
	if (m->rows > 0 && row[0] <= m->row[m->rows - 1][0]) {
		snprintf(problem, size, "row %zu: time %g s does not rise", m->rows + 1, row[0]);
		return false;
	}
	if (m->rows == g->capacity) {
		const size_t capacity = g->capacity == 0 ? 4096 : 2 * g->capacity;
		void *grown = realloc(m->row, capacity * sizeof(m->row[0]));

		if (grown == NULL) {
			snprintf(problem, size, "no memory for %zu rows", capacity);
			return false;
		}
		m->row = grown;
		g->capacity = capacity;
	}
	memcpy(m->row[m->rows++], row, sizeof(m->row[0]));
	return true;
}

static bool parse_row(const char *line, double row[MOTION_COLUMNS])
{
	const char *at = line;

	for (int column = 0; column < MOTION_COLUMNS; column++) {
		char *end;

		row[column] = strtod(at, &end);
		if (end == at) {
			return false;
		}
		at = end;
		if (column + 1 < MOTION_COLUMNS) {
			if (*at != ',') {
				return false;
			}
			at++;
		}
	}
	return at[strspn(at, " \t\r\n")] == '\0';
}

static bool read_text(FILE *file, struct growing *g, char *problem, size_t size)
{
	char line[LINE_MAX_SIZE];
	unsigned int number = 0;
	bool has_header = false;

	while (fgets(line, sizeof(line), file) != NULL) {
		double row[MOTION_COLUMNS];

		number++;
		line[strcspn(line, "\r\n")] = '\0';
		if (line[0] == '#' || line[0] == '\0') {
			continue;
		}
		if (!has_header) {
			if (strcmp(line, TEXT_HEADER) != 0) {
				snprintf(problem, size, "line %u must be: " TEXT_HEADER, number);
				return false;
			}
			has_header = true;
			continue;
		}
		if (!parse_row(line, row)) {
			snprintf(problem, size, "line %u does not hold seven numbers", number);
			return false;
		}
		if (!append(g, row, problem, size)) {
			return false;
		}
	}
	return true;
}

static uint64_t little_endian(const unsigned char *bytes, int count)
{
	uint64_t value = 0;

	for (int i = count - 1; i >= 0; i--) {
		value = value << 8 | bytes[i];
	}
	return value;
}

static bool read_binary(FILE *file, struct growing *g, char *problem, size_t size)
{
	unsigned char header[HEADER_SIZE - MAGIC_SIZE];
	uint64_t rows;

	if (fread(header, sizeof(header), 1, file) != 1) {
		snprintf(problem, size, "cut in the header");
		return false;
	}
	if (little_endian(header, 4) != VERSION) {
		snprintf(problem, size, "version %u, only %d is known",
			 (unsigned int)little_endian(header, 4), VERSION);
		return false;
	}
	rows = little_endian(header + 4, 4);
	for (uint64_t i = 0; i < rows; i++) {
		unsigned char bytes[8 * MOTION_COLUMNS];
		double row[MOTION_COLUMNS];

		if (fread(bytes, sizeof(bytes), 1, file) != 1) {
			snprintf(problem, size, "cut in row %u of %u", (unsigned int)i + 1,
				 (unsigned int)rows);
			return false;
		}
		for (int column = 0; column < MOTION_COLUMNS; column++) {
			const uint64_t raw = little_endian(bytes + 8 * column, 8);

			memcpy(&row[column], &raw, sizeof(raw));
		}
		if (!append(g, row, problem, size)) {
			return false;
		}
	}
	return true;
}

struct motion *motion_load(const char *path, char *problem, size_t problem_size)
{
	struct growing g = {.motion = calloc(1, sizeof(struct motion))};
	char magic[MAGIC_SIZE] = {0};
	FILE *file = fopen(path, "rb");
	bool good = false;

	if (g.motion == NULL) {
		snprintf(problem, problem_size, "no memory");
	} else if (file == NULL) {
		snprintf(problem, problem_size, "%s", strerror(errno));
	} else if (fread(magic, 1, sizeof(magic), file) == sizeof(magic) &&
		   memcmp(magic, MAGIC, sizeof(magic)) == 0) {
		good = read_binary(file, &g, problem, problem_size);
	} else {
		rewind(file);
		good = read_text(file, &g, problem, problem_size);
	}
	if (good && g.motion->rows == 0) {
		snprintf(problem, problem_size, "it has no rows");
		good = false;
	}
	if (file != NULL) {
		fclose(file);
	}
	if (!good) {
		motion_free(g.motion);
		return NULL;
	}
	return g.motion;
}

void motion_free(struct motion *m)
{
	if (m != NULL) {
		free(m->row);
		free(m);
	}
}

void motion_at(struct motion *m, double t_s, struct chip_motion *at)
{
	const double *before;
	const double *after;
	double share = 0.0;

	if (m->near >= m->rows || m->row[m->near][0] > t_s) {
		m->near = 0;
	}
	while (m->near + 1 < m->rows && m->row[m->near + 1][0] <= t_s) {
		m->near++;
	}
	before = m->row[m->near];
	after = m->near + 1 < m->rows ? m->row[m->near + 1] : before;
	if (t_s > before[0] && after != before) {
		share = (t_s - before[0]) / (after[0] - before[0]);
	}
	for (int i = 0; i < 3; i++) {
		at->accel_mps2[i] = before[1 + i] + share * (after[1 + i] - before[1 + i]);
		at->gyro_radps[i] = before[4 + i] + share * (after[4 + i] - before[4 + i]);
	}
}
