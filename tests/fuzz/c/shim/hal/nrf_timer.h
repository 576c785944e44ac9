/* SPDX-License-Identifier: Apache-2.0 */
/* Nothing of the hardware is touched by what is fuzzed. */
