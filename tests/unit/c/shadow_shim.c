/* SPDX-License-Identifier: Apache-2.0 */
/* The shadow log's means and lines, called from Python. */
#include <string.h>

#include "shadow_mean.h"
#include "shadow_row.h"

#define ROWS_MAX 4096U

static struct shadow_mean mean;
static struct shadow_row rows[ROWS_MAX];
static size_t count;

static void keep(const struct shadow_row *row)
{
	if (count < ROWS_MAX) {
		rows[count++] = *row;
	}
}

void shim_begin(void)
{
	memset(&mean, 0, sizeof(mean));
	count = 0;
}

/* One batch as the wire has it; returns how many rows there are by then. */
size_t shim_push(const uint8_t *payload, size_t len)
{
	static struct wire_imu_batch batch;

	if (wire_imu_batch_get(&batch, payload, len)) {
		shadow_mean_push(&mean, &batch, keep);
	}
	return count;
}

size_t shim_text(size_t row, char *text)
{
	return shadow_row_text(&rows[row], text);
}

size_t shim_text_of(uint64_t t_us, int32_t accel, int32_t gyro, uint16_t flags, char *text)
{
	const struct shadow_row row = {
		.t_us = t_us,
		.accel = {accel, accel, accel},
		.gyro = {gyro, gyro, gyro},
		.flags = flags,
	};

	return shadow_row_text(&row, text);
}
