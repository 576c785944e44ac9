/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Why the node stopped: kept over the reboot that follows, and told after it.
 */
#ifndef BV_LAST_WORDS_H_
#define BV_LAST_WORDS_H_

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Longest name of a thread and of what it did, with the NUL. */
#define LAST_WORDS_NAME_SIZE 16U

struct last_words {
	/** A WIRE_FAULT_CODE_.... */
	uint16_t code;
	/** K_ERR_... of Zephyr, or the ARM architecture's. */
	uint16_t reason;
	/** Where; 0 when unknown, as always in simulation. */
	uint32_t pc;
	/** Whereto it would have returned. */
	uint32_t lr;
	char thread[LAST_WORDS_NAME_SIZE];
	/** What was stuck; empty for an error. */
	char part[LAST_WORDS_NAME_SIZE];
};

/** Keep @p words and reboot. From anywhere. */
_Noreturn void last_words_say(const struct last_words *words);

/** Send what the node said before this boot as a FAULT, once. */
void last_words_report(void);

#ifdef __cplusplus
}
#endif

#endif /* BV_LAST_WORDS_H_ */
