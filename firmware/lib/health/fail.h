/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Failing on command, in images for tests.
 */
#ifndef BV_FAIL_H_
#define BV_FAIL_H_

#include <errno.h>
#include <stdint.h>

#include "watchdog.h"

#ifdef __cplusplus
extern "C" {
#endif

#if defined(CONFIG_BV_FAULT_COMMANDS)

/** Take WIRE_NODE_COMMAND_FAIL_.... @return -EINVAL when it is none. */
int fail_command(uint8_t command);

/** Never return when this part was told to hang. */
void fail_if_told(enum watchdog_part part);

#else

static inline int fail_command(uint8_t command)
{
	(void)command;
	return -EINVAL;
}

static inline void fail_if_told(enum watchdog_part part)
{
	(void)part;
}

#endif

#ifdef __cplusplus
}
#endif

#endif /* BV_FAIL_H_ */
