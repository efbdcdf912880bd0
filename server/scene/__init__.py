"""The live 3D scene: mission events become viser nodes with fixed names."""
