/* SPDX-License-Identifier: Apache-2.0 */
#include "shadow_log.h"

#include <zephyr/kernel.h>

#include "diag_uart.h"
#include "shadow_mean.h"

/* A third of a second. */
K_MSGQ_DEFINE(rows, sizeof(struct shadow_row), 32, 8);

static void put(const struct shadow_row *row)
{
	if (k_msgq_put(&rows, row, K_NO_WAIT) != 0) {
		diag_uart_count_dropped();
	}
}

void shadow_log_sample(const struct shadow_row *row)
{
	static uint64_t next_us;

	if (row->t_us >= next_us) {
		next_us = row->t_us - row->t_us % SHADOW_PERIOD_US + SHADOW_PERIOD_US;
		put(row);
	}
}

void shadow_log_batch(const struct wire_imu_batch *batch)
{
	static struct shadow_mean mean;

	shadow_mean_push(&mean, batch, put);
}

static void write_rows(void *p1, void *p2, void *p3)
{
	static char text[SHADOW_TEXT_MAX];
	struct shadow_row row;

	ARG_UNUSED(p1);
	ARG_UNUSED(p2);
	ARG_UNUSED(p3);
	for (;;) {
		(void)k_msgq_get(&rows, &row, K_FOREVER);
		(void)shadow_row_text(&row, text);
		diag_uart_line(text);
	}
}

K_THREAD_DEFINE(bv_shadow, 1024, write_rows, NULL, NULL, NULL, K_PRIO_PREEMPT(8), 0, 0);
