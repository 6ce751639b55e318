# Bare-metal Cortex-M7 with a double-precision FPU; "ctest" runs on QEMU's board mps2-an500.
#   apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm
#   cmake -B build-m7 -DCMAKE_TOOLCHAIN_FILE=cortex_m7/toolchain.cmake && cmake --build build-m7 && ctest --test-dir build-m7
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR cortex-m7)
set(CMAKE_C_COMPILER arm-none-eabi-gcc)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
if(NOT FSW_FPU)
  set(FSW_FPU "-mfpu=fpv5-d16 -mfloat-abi=hard")
endif()
set(CMAKE_C_FLAGS_INIT "-mcpu=cortex-m7 -mthumb ${FSW_FPU} -ffunction-sections -fdata-sections")
set(CMAKE_EXE_LINKER_FLAGS_INIT
    "--specs=rdimon.specs -Wl,--gc-sections -T ${CMAKE_CURRENT_LIST_DIR}/memory.ld")
set(FSW_BOARD ${CMAKE_CURRENT_LIST_DIR}/startup.c)
# a nanosecond of virtual time is an eighth of an instruction
set(CMAKE_CROSSCOMPILING_EMULATOR
    qemu-system-arm -M mps2-an500 -display none -monitor none -serial none
    -semihosting-config enable=on,target=native -icount shift=3 -kernel)
