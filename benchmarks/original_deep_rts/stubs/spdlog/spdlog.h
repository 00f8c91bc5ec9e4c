// Stands in for spdlog: warnings are dropped. None is written while a game is played.
#pragma once

#include <string>

#define SPDLOG_WARN(...) ((void)0)
