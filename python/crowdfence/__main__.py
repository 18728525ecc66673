from crowdfence.cli import main

main()
