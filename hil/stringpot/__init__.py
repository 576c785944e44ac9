# SPDX-License-Identifier: Apache-2.0
"""``hil stringpot``: a string potentiometer on an ESP32 as an outside reference of the bar."""
