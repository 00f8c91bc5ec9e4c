// Stands in for OpenCV: a headless game holds an image and never draws on it.
#pragma once

namespace cv {
struct Mat {
    Mat() {}
};
}  // namespace cv
