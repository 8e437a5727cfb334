#!/bin/sh
# Flashes an image and shows its log. Which board it is for stands in the image: the folder that its code comes from.
set -eu
if grep -qa nucleo_h743zi2 "$1"; then
    chip=STM32H743ZITx
else
    chip=STM32F429ZITx
fi
exec probe-rs run --chip "$chip" "$@"
