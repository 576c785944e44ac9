/* SPDX-License-Identifier: Apache-2.0 */
#include "line.h"

#include <zephyr/ztest.h>

#include "diag_report.h"
#include "diag_uart.h"
#include "sync_timer.h"

struct line line;

void diag_uart_frame(uint8_t type, const uint8_t *payload, size_t len)
{
	if (type == WIRE_CAL_STATUS_ID) {
		zassert_true(wire_cal_status_get(&line.status, payload, len));
		line.statuses++;
	} else if (type == WIRE_CAL_RECORD_ID) {
		zassert_true(wire_cal_record_get(&line.record, payload, len));
		line.records++;
	} else {
		zassert_unreachable("frame %u", type);
	}
}

void diag_report_fault(uint16_t code, uint32_t argument, const char *detail)
{
	zassert_true(strlen(detail) <= WIRE_FAULT_DETAIL_COUNT, "%s", detail);
	line.fault_code = code;
	line.fault_argument = argument;
	line.faults++;
}

uint64_t sync_timer_now_ticks(void)
{
	return 77;
}
