/* SPDX-License-Identifier: Apache-2.0 */
/* The diagnostic line, as far as the calibration sees it: what was sent last, and how often. */
#ifndef BV_TEST_LINE_H_
#define BV_TEST_LINE_H_

#include <stdint.h>

#include "wire.h"

struct line {
	uint32_t statuses;
	uint32_t records;
	uint32_t faults;
	struct wire_cal_status status;
	struct wire_cal_record record;
	uint16_t fault_code;
	uint32_t fault_argument;
};

extern struct line line;

#endif /* BV_TEST_LINE_H_ */
