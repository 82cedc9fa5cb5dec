# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Packaging that both pip and colcon read: plain strings, no metadata elsewhere."""

from pathlib import Path
import platform

from setuptools import Extension, find_packages, setup

PACKAGE = 'gip_localizer'
# Every x86-64 processor since 2011 has SSSE3; instructions of newer ones are detected at run time.
COMPILE = ['-O3', '-Wno-psabi', *(['-mssse3'] if platform.machine() == 'x86_64' else [])]


def files(folder, pattern='*'):
    """Every file of a folder that matches, as data_files wants them."""
    return sorted(str(path) for path in Path(folder).glob(pattern) if path.is_file())


setup(
    name=PACKAGE,
    version='0.1.0',
    description='Camera localization on a road map by the Gramian-weighted inner product.',
    long_description=Path('README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    license='Apache-2.0',
    author='gip_localizer contributors',
    maintainer='gip_localizer contributors',
    maintainer_email='gip_localizer@example.org',
    python_requires='>=3.10',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['py.typed', '**/*.html', '**/*.j2', '**/*.csv']},
    # Plain C that is loaded with ctypes; without a compiler NumPy and SciPy do its work.
    ext_modules=[Extension(
        f'{PACKAGE}.core.kernels._kernels', files(f'{PACKAGE}/core/kernels', '*.c'),
        depends=files(f'{PACKAGE}/core/kernels', '*.h'),
        extra_compile_args=COMPILE, optional=True,
    )],
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/config', files('config')),
        (f'share/{PACKAGE}/config/presets', files('config/presets')),
        (f'share/{PACKAGE}/launch', files('launch', '*.py')),
        # pip puts entry points into bin/ only; ros2 looks here.
        (f'lib/{PACKAGE}', files('resource/executables')),
    ],
    install_requires=[
        'numpy>=1.26',
        'scipy',
        'opencv-python-headless>=4.6',
        'simplejpeg',
        'mcap',
        'rosbags',
        'zstandard',
        'apsw',
        'PyYAML',
        'matplotlib',
        'tqdm',
        'jinja2',
    ],
    extras_require={
        # Never in install_requires: a machine with ROS has its own rclpy.
        'ros': [
            'ros-jazzy-rclpy',
            'ros-jazzy-common-interfaces',
            'ros-jazzy-rmw-fastrtps-cpp',
        ],
        # H.264 and H.265 images.
        'video': ['av'],
        # The documents as a site.
        'docs': ['mkdocs'],
        'test': [
            'av',
            'mkdocs',
            'pytest',
            'pytest-xdist',
            'hypothesis',
            'psutil',
            'ruff',
            'mypy',
            'types-PyYAML',
            'types-tqdm',
            'evo',
            'setuptools>=65',
            'wheel',
            'colcon-core',
            'colcon-ros',
            'colcon-python-setup-py',
            'colcon-recursive-crawl',
            'colcon-library-path',
        ],
    },
    zip_safe=False,
    entry_points={
        'console_scripts': [
            f'localizer = {PACKAGE}.ros.entry:localizer',
            f'synthetic_camera = {PACKAGE}.ros.entry:synthetic_camera',
            f'bag_player = {PACKAGE}.ros.entry:bag_player',
            f'gip = {PACKAGE}.cli:main',
        ],
    },
)
